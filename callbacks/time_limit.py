"""Callback that ends training at a deadline."""

from __future__ import annotations

from typing import Any

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

    def state_dict(self) -> dict[str, Any]:
        """Return the epoch at which training was ended."""
        return {"ended_at": self.ended_at}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take it from a fit in other processes."""
        self.ended_at = state_dict["ended_at"]

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Look at the clock; all processes end together."""
        is_over = trainer.strategy.reduce_boolean_decision(self.deadline.is_over, all=False)
        if is_over and trainer.current_epoch + 1 < (trainer.max_epochs or 0):
            self.ended_at = trainer.current_epoch + 1
            trainer.should_stop = True
