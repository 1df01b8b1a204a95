"""Callback that updates the progress bar of a stage."""

from __future__ import annotations

from lightning import Callback, LightningModule, Trainer

from dashred.core.progress import Report


class StageProgress(Callback):
    """Show the share of finished epochs and the latest value of one metric."""

    def __init__(self, report: Report, metric: str, label: str) -> None:
        self.report, self.metric, self.label = report, metric, label

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, *args: object
    ) -> None:
        """Update the bar."""
        done = trainer.global_step / max(1, trainer.estimated_stepping_batches)
        self.report(float(done), "")

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Show the metric."""
        value = trainer.callback_metrics.get(self.metric)
        if value is not None and not trainer.sanity_checking:
            epoch = trainer.current_epoch + 1
            self.report(epoch / (trainer.max_epochs or 1), f"{self.label} {float(value):.3f}")
