"""Callback that records RMSE and loss curves by epoch, for MLflow and the figures."""

from __future__ import annotations

from typing import Any

from lightning import Callback, LightningModule, Trainer

from dashred.core.tracking import Log


class RMSECurves(Callback):
    """Log every ``rmse/…`` and ``loss/…`` metric by epoch.

    Lightning's own logger counts batches, so that runs with different batch sizes cannot be
    compared. Here the step is the epoch; epoch 0 is the state before training.

    Attributes:
        history: metric → list of (epoch, value).

    Args:
        child: log of the nested run, which gets the curves.
        parent: log of the run of the command; it gets the RMSEs under ``prefix``, so that commands
            can be compared.
        prefix: for example ``assimilate``.
    """

    def __init__(self, child: Log, parent: Log, prefix: str) -> None:
        self.child, self.parent, self.prefix = child, parent, prefix
        self.history: dict[str, list[tuple[int, float]]] = {}

    def state_dict(self) -> dict[str, Any]:
        """Return the curves."""
        return {"history": self.history}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take them from a fit in other processes."""
        self.history = state_dict["history"]

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Log the epoch's metrics."""
        epoch = 0 if trainer.sanity_checking else trainer.current_epoch + 1
        found = {
            name: float(value)
            for name, value in trainer.callback_metrics.items()
            if name.startswith("rmse/")
        }
        self._log(found, epoch)
        self.parent({f"{self.prefix}/{k}": v for k, v in found.items()}, epoch)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Log the losses of the epoch, which are complete only now."""
        losses = {
            name: float(value)
            for name, value in trainer.callback_metrics.items()
            if name.startswith("loss/")
        }
        self._log(losses, trainer.current_epoch + 1)

    def _log(self, found: dict[str, float], epoch: int) -> None:
        self.child(found, epoch)
        for name, value in found.items():
            self.history.setdefault(name, []).append((epoch, value))
