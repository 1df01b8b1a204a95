"""Fit a network with Lightning: in this process, or in several that Lightning starts."""

from __future__ import annotations

import os
import signal
from pickle import PicklingError
from typing import Any, Protocol

from lightning import LightningDataModule, LightningModule, Trainer
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from lightning.pytorch.callbacks import Callback
from torch.multiprocessing.spawn import ProcessExitedException, ProcessRaisedException

from dashred.config import Config
from dashred.config.network_devices import accelerator as accelerator_of
from dashred.config.network_devices import process_count
from dashred.core.errors import InputError
from dashred.pipeline.networks.remote_calls import Function, RemoteCalls
from dashred.pipeline.networks.worker import Worker

PORT = "MASTER_PORT"
RAISED = f"\n{InputError.__module__}.{InputError.__qualname__}: "


class Fitting(Protocol):
    """Where one network is fitted."""

    def accept(self, function: Function) -> Function:
        """Return a function that callbacks can call; it runs in the process of the analysis."""

    def fit(
        self,
        module: LightningModule,
        data: LightningDataModule,
        callbacks: list[Callback],
        **settings: Any,
    ) -> None:
        """Fit the network; module and callbacks have their state of the end of the fit afterwards.

        Args:
            module: the network.
            data: its data.
            callbacks: of the trainer; the trainer logs through them only.
            settings: of the trainer, such as ``max_epochs``.
        """


def fitting(config: Config) -> Fitting:
    """Return where the next network of a configuration is fitted."""
    return FitHere(config) if process_count(config) is None else FitInProcesses(config)


class FitHere:
    """A fit in the process of the analysis, on one device.

    Args:
        config: of the analysis.
        accelerator: ``cpu`` or ``gpu``; None takes that of the configuration.
    """

    def __init__(self, config: Config, accelerator: str | None = None) -> None:
        self.config, self.accelerator = config, accelerator or accelerator_of(config)

    def accept(self, function: Function) -> Function:
        """Return the function as it is."""
        return function

    def fit(
        self,
        module: LightningModule,
        data: LightningDataModule,
        callbacks: list[Callback],
        **settings: Any,
    ) -> None:
        """Fit the network; see :class:`Fitting`."""
        index = self.config.device.partition(":")[2]
        devices = [int(index or 0)] if self.accelerator == "gpu" else 1
        trainer = _trainer(self.accelerator, devices=devices, callbacks=callbacks, **settings)
        trainer.fit(module, data)


class FitInProcesses:
    """A fit in processes of Lightning's strategy ``ddp_spawn``, each with its share of a batch.

    They get copies of the network, its data and the callbacks. Lightning returns the weights; the
    callbacks' states are sent by a :class:`Worker`.
    """

    def __init__(self, config: Config) -> None:
        self.config, self.calls = config, RemoteCalls()

    def accept(self, function: Function) -> Function:
        """Return a function whose copies in the other processes call it in this one."""
        return self.calls.accept(function)

    def fit(
        self,
        module: LightningModule,
        data: LightningDataModule,
        callbacks: list[Callback],
        **settings: Any,
    ) -> None:
        """Fit the network; see :class:`Fitting`.

        Raises:
            InputError: a process raised it or was killed, or the network cannot be sent to one.
        """

        def load(states: list[dict[str, Any]]) -> None:
            for callback, state in zip(callbacks, states, strict=True):
                callback.load_state_dict(state)

        worker = Worker(self.config.threads, callbacks, self.accept(load))
        trainer = _trainer(
            accelerator_of(self.config),
            devices=process_count(self.config),
            strategy="ddp_spawn",
            # Lightning starts the processes, also where SLURM or torchrun started this one.
            plugins=[LightningEnvironment()],
            callbacks=[*callbacks, worker],
            **settings,
        )
        where, port = self.config.where("trainer.devices"), os.environ.get(PORT)
        try:
            with self.calls.served():
                try:
                    trainer.fit(module, data)
                finally:
                    # Ctrl-C may have ended the fit in this process alone.
                    if trainer.strategy.launcher is not None:
                        trainer.strategy.launcher.kill(signal.SIGKILL)
        except ProcessRaisedException as raised:
            # It is the text of the traceback.
            _, is_input, text = str(raised).rpartition(RAISED)
            if is_input:
                raise InputError(text.strip()) from raised
            raise
        except ProcessExitedException as ended:
            raise InputError(
                f"the networks are trained in other processes, and {ended}",
                where=where,
                hint="fewer trainer.devices need less memory",
            ) from ended
        except (PicklingError, TypeError, AttributeError) as error:
            raise InputError(
                f"the simulator cannot be sent to other processes: {error}",
                where=where,
                hint="choose trainer.devices=null and trainer.strategy=null",
            ) from error
        finally:
            if port is None:
                os.environ.pop(PORT, None)
        if self.calls.error is not None:
            raise self.calls.error


def _trainer(accelerator: str, **settings: Any) -> Trainer:
    """Return a trainer that logs through its callbacks only."""
    return Trainer(
        accelerator=accelerator,
        num_sanity_val_steps=-1,
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        use_distributed_sampler=False,  # the data modules share the batches
        **settings,
    )
