"""Callback that ends training at a deadline."""

from __future__ import annotations

from lightning import Callback, LightningModule, Trainer

from dashred.core.budget import Deadline


class TimeLimit(Callback):
    """End training after the epoch in which the time is up; one epoch is always trained.

    Attributes:
        ended_at: number of epochs after which the training was ended; None if it was not.
    """

    def __init__(self, deadline: Deadline) -> None:
        self.deadline = deadline
        self.ended_at: int | None = None

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Look at the clock."""
        if self.deadline.is_over and trainer.current_epoch + 1 < (trainer.max_epochs or 0):
            self.ended_at = trainer.current_epoch + 1
            trainer.should_stop = True
