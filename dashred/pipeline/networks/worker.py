"""Callback for a process that fits a network: its settings, and what it returns."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any

from lightning import Callback, LightningModule, Trainer

from dashred.core.errors import InputError
from dashred.models.torch_setup import set_up_torch


class Worker(Callback):
    """Set up the process, and return the states of the other callbacks at the end.

    Args:
        threads: number of threads for trajectories.
        callbacks: the other callbacks.
        load: takes their states in the process of the analysis.
        fail: takes an error of the input there.
    """

    def __init__(
        self,
        threads: int,
        callbacks: Sequence[Callback],
        load: Callable[[list[dict[str, Any]]], None],
        fail: Callable[[InputError], None],
    ) -> None:
        self.threads, self.callbacks = threads, callbacks
        self.load, self.fail = load, fail

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Set up the process when the callback arrives there, before Lightning starts to work."""
        self.__dict__.update(state)
        set_up_torch(self.threads)
        logging.getLogger("lightning.fabric").setLevel(logging.ERROR)

    def on_fit_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Return the states."""
        self.load([callback.state_dict() for callback in self.callbacks])

    def on_exception(
        self, trainer: Trainer, pl_module: LightningModule, exception: BaseException
    ) -> None:
        """Return an error of the input; others are errors of the program, with a traceback."""
        if isinstance(exception, InputError):
            self.fail(exception)
