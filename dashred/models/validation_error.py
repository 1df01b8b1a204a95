"""RMSE over the validation batches of all processes."""

from __future__ import annotations

from lightning import LightningModule
from torch import Tensor


def log_squares(module: LightningModule, name: str, mean: Tensor, count: int) -> None:
    """Add the mean square of the errors of one batch.

    Args:
        module: module that validates.
        name: of the metric, without ``rmse/``.
        mean: mean square over the batch, a scalar.
        count: number of values in this mean; it may be 0.
    """
    # Lightning's own mean over processes rounds their mean number of samples to a whole number.
    sums: dict[str, Tensor | float] = {"squares": mean * count, "values": float(count)}
    for part, value in sums.items():
        module.log(f"{part}/{name}", value, on_epoch=True, reduce_fx="sum", sync_dist=True)


def log_rmse(module: LightningModule, name: str) -> None:
    """Log ``rmse/<name>`` over all batches, unless they have no values."""
    metrics = module.trainer.callback_metrics
    squares, count = metrics[f"squares/{name}"], metrics[f"values/{name}"]
    if count > 0:
        module.log(f"rmse/{name}", (squares / count).sqrt(), sync_dist=True)
