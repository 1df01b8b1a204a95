"""Callback that restores the weights with the best metric, including the initial weights."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any

from lightning import Callback, LightningModule, Trainer
from torch import Tensor


def _accept(module: LightningModule) -> bool:
    """Accept every state. A fit on several devices sends this to its processes by name."""
    return True


class BestState(Callback):
    """Restore the best state at the end of training.

    Lightning's checkpoints start after the first epoch. Here the initial state counts too, so that
    assimilation cannot increase the error on the validation sensors. This needs a sanity check
    over all validation batches (``num_sanity_val_steps=-1``).

    Args:
        monitor: metric to minimise.
        gain: relative improvement over the initial state that is needed to replace it, because a
            metric over few sensors can decrease by chance.
        floor: value that the metric has by noise alone. States at or below it are equally good,
            and the latest of them is taken.
        accepts: whether the state of a module may be taken.

    Attributes:
        best: lowest value of the metric, not below the floor.
        best_epoch: number of epochs trained until then; 0 is the initial state.
    """

    def __init__(
        self,
        monitor: str,
        gain: float = 0.0,
        floor: float = 0.0,
        accepts: Callable[[LightningModule], bool] = _accept,
    ) -> None:
        self.monitor, self.gain, self.floor, self.accepts = monitor, gain, floor, accepts
        self.best, self.best_epoch, self.required = math.inf, 0, math.inf
        self._state: dict[str, Tensor] = {}

    def state_dict(self) -> dict[str, Any]:
        """Return the best metric and its epoch."""
        return {"best": self.best, "best_epoch": self.best_epoch}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take them from a fit in other processes, which has restored the weights."""
        self.best, self.best_epoch = state_dict["best"], state_dict["best_epoch"]

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Copy the weights if they are the best so far."""
        value = trainer.callback_metrics.get(self.monitor)
        if value is not None and self._is_better(float(value)) and self.accepts(pl_module):
            if not self._state:
                self.required = (1 - self.gain) * float(value)
            self.best = max(float(value), self.floor)
            self.best_epoch = 0 if trainer.sanity_checking else trainer.current_epoch + 1
            self._state = copy.deepcopy(pl_module.state_dict())

    def _is_better(self, value: float) -> bool:
        return value <= self.floor or value < min(self.best, self.required)

    def on_fit_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Restore the best weights."""
        if self._state:
            pl_module.load_state_dict(self._state)
