"""Keep the weights with the best monitored metric, the state before training included."""

from __future__ import annotations

import copy
import math

from lightning import Callback, LightningModule, Trainer
from torch import Tensor


class BestState(Callback):
    """Restore the best state at the end of training.

    Lightning's checkpoints begin after the first epoch; here the state that training starts from
    competes too, so that assimilation can only help on the validation sensors. Run the sanity
    check over all validation batches (``num_sanity_val_steps=-1``) for that.

    Args:
        monitor: metric to minimise.
        gain: share by which a state must beat the one before training to replace it; a metric
            over few sensors can fall by chance.

    Attributes:
        best: lowest value seen.
        best_epoch: epochs trained until then; 0 is the state before training.
    """

    def __init__(self, monitor: str, gain: float = 0.0) -> None:
        self.monitor, self.gain = monitor, gain
        self.best, self.best_epoch, self.required = math.inf, 0, math.inf
        self._state: dict[str, Tensor] = {}

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Keep a copy of the weights if they are the best so far."""
        value = trainer.callback_metrics.get(self.monitor)
        if value is not None and float(value) < min(self.best, self.required):
            if not self._state:
                self.required = (1 - self.gain) * float(value)
            self.best = float(value)
            self.best_epoch = 0 if trainer.sanity_checking else trainer.current_epoch + 1
            self._state = copy.deepcopy(pl_module.state_dict())

    def on_fit_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Put the best weights back."""
        if self._state:
            pl_module.load_state_dict(self._state)
