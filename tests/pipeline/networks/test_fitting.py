"""Where a network is fitted, and what becomes of errors in other processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from typing import Any

import pytest
import torch
from lightning import LightningDataModule, LightningModule, Trainer
from lightning.pytorch.callbacks import Callback
from torch import nn

from callbacks import BestState
from dashred.core.errors import InputError
from dashred.pipeline.networks.fitting import FitHere, FitInProcesses, fitting
from datamodules.batches import Batches, Share, ordered_batches
from tests.pipeline.networks.conftest import Configured

POINTS = torch.linspace(-1, 1, 12)[:, None]
TWO_CPUS = pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="needs two CPUs")


class Line(LightningModule):
    """A line through points of a steeper one."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        self.line = nn.Linear(1, 1)

    def error(self, batch: Any) -> torch.Tensor:
        """Return the mean squared error."""
        return (self.line(batch[0]) - 3 * batch[0]).square().mean()

    def training_step(self, batch: Any, index: int) -> torch.Tensor:
        """Return the loss."""
        return self.error(batch)

    def validation_step(self, batch: Any, index: int) -> None:
        """Log the error."""
        self.log("rmse/line", self.error(batch), sync_dist=True)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return gradient descent."""
        return torch.optim.SGD(self.parameters(), lr=0.1)


class Points(LightningDataModule):
    """The points, for training and for validation."""

    def train_dataloader(self) -> Batches:
        """Return batches of four."""
        return ordered_batches((POINTS,), 4, Share.of(self.trainer))

    def val_dataloader(self) -> Batches:
        """Return all points."""
        return ordered_batches((POINTS,), 12, Share.of(self.trainer))


class Refuses(Callback):
    """Finds an error of the input in the process of rank zero."""

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Raise it."""
        if trainer.is_global_zero:
            raise InputError("the record is too short", where="here", hint="take a longer one")


class Ends(Callback):
    """Is killed in the second process, as by a system without memory."""

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """End the process."""
        if not trainer.is_global_zero:
            os.kill(os.getpid(), signal.SIGKILL)


class Interrupts(Callback):
    """Sends Ctrl-C to the process of the analysis alone, and goes on for minutes."""

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Send it."""
        if trainer.is_global_zero:
            os.kill(os.getppid(), signal.SIGINT)
        time.sleep(300)


def test_a_fit_on_one_device_is_that_of_a_plain_trainer(configured: Configured) -> None:
    here, plain = Line(), Line()
    place = fitting(configured().problem.config)
    assert isinstance(place, FitHere)
    assert place.accept(print) is print
    place.fit(here, Points(), [BestState("rmse/line")], max_epochs=3)
    trainer = Trainer(
        accelerator="cpu",
        devices=1,
        max_epochs=3,
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    trainer.fit(plain, Points())
    assert torch.equal(here.line.weight, plain.line.weight)
    assert torch.equal(here.line.bias, plain.line.bias)


def test_what_cannot_be_sent_is_one_message(configured: Configured) -> None:
    module = Line()
    module.unsendable = lambda: None  # type: ignore[assignment]
    place = fitting(configured("trainer.devices=2").problem.config)
    assert isinstance(place, FitInProcesses)
    with pytest.raises(InputError, match="cannot be sent to other processes") as caught:
        place.fit(module, Points(), [], max_epochs=1)
    assert caught.value.where == "command line"
    assert "trainer.devices=null" in (caught.value.hint or "")
    assert "MASTER_PORT" not in os.environ


@pytest.mark.slow
@TWO_CPUS
@pytest.mark.parametrize(
    ("callback", "what"),
    [(Refuses(), "the record is too short"), (Ends(), "terminated with signal SIGKILL")],
)
def test_an_error_in_another_process_ends_the_fit(
    configured: Configured, callback: Callback, what: str
) -> None:
    place = fitting(configured("trainer.devices=2").problem.config)
    with pytest.raises(InputError, match=what):
        place.fit(Line(), Points(), [callback], max_epochs=2)
    assert "MASTER_PORT" not in os.environ


@pytest.mark.slow
@TWO_CPUS
def test_ctrl_c_ends_the_other_processes(configured: Configured) -> None:
    place, before = fitting(configured("trainer.devices=2").problem.config), time.monotonic()
    handler = signal.getsignal(signal.SIGINT)
    try:
        with pytest.raises(SystemExit):
            place.fit(Line(), Points(), [Interrupts()], max_epochs=1)
    finally:
        signal.signal(signal.SIGINT, handler)  # Lightning ignores further ones
    assert time.monotonic() - before < 250
    for process in multiprocessing.active_children():
        process.join(60)
        assert not process.is_alive()
