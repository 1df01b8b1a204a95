"""Callback for a process that fits a network: its settings, and what it returns."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any

from lightning import Callback, LightningModule, Trainer

from dashred.models.torch_setup import set_up_torch


class Worker(Callback):
    """Set up the process, and return the states of the other callbacks at the end.

    Args:
        threads: number of threads for trajectories.
        callbacks: the other callbacks.
        load: takes their states in the process of the analysis.
    """

    def __init__(
        self,
        threads: int,
        callbacks: Sequence[Callback],
        load: Callable[[list[dict[str, Any]]], None],
    ) -> None:
        self.threads, self.callbacks, self.load = threads, callbacks, load

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Keep Lightning quiet from the arrival in the process on: it announces the processes."""
        self.__dict__.update(state)
        for name in ("lightning.fabric", "lightning.pytorch"):
            logging.getLogger(name).setLevel(logging.ERROR)

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Set up torch; Lightning has chosen another number of threads before."""
        set_up_torch(self.threads)

    def on_fit_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Return the states."""
        self.load([callback.state_dict() for callback in self.callbacks])
