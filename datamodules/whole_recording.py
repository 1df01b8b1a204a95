"""A recording as one batch, for objectives that link each sample to the next."""

from __future__ import annotations

from lightning import LightningDataModule

from datamodules.batches import Batches, ordered_batches
from datamodules.recording import RecordingDataModule


class WholeRecordingDataModule(LightningDataModule):
    """All windows and targets of a recording in one batch, in order of time.

    Args:
        source: the recording.
    """

    def __init__(self, source: RecordingDataModule) -> None:
        super().__init__()
        self.source = source

    def train_dataloader(self) -> Batches:
        """Return (windows, fitted values) of all samples."""
        return ordered_batches((self.source.windows, self.source.fitted), len(self.source.windows))

    def val_dataloader(self) -> Batches:
        """Return (windows, fitted values, validated values) of all samples."""
        source = self.source
        tensors = source.windows, source.fitted, source.validated.float()
        return ordered_batches(tensors, len(source.windows))
