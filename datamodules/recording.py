"""The real recording as windows and targets for assimilation."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from lightning import LightningDataModule
from torch import Tensor

from dashred.data.recording import Recording
from dashred.models.lag_windows import windows
from datamodules.batches import Batches, Share, ordered_batches, shuffled_batches


class RecordingDataModule(LightningDataModule):
    """Windows, fit targets and validation targets of one recording.

    The constructor gets only the fit and validation parts of the split, so that test sensors and
    held-out times cannot be used.

    Attributes:
        windows: histories s' of SHRED's input sensors, ``(time, lag, sensor)``, float32.
        fitted: values of the p + q fit sensors, ``(time, sensor)``, NaN where missing.
        validated: values of the validation sensors, ``(time, sensor)``, NaN where missing. Without
            validation sensors, values of the fit sensors, NaN before the validation interval.

    Args:
        fit: recording of the fit sensors; defines the clock of the module.
        validation: recording of the validation sensors, or a later part of the fit sensors.
        inputs: names of SHRED's input sensors.
        lags: number of past samples in a window.
        batch: windows per batch.
        seed: of the order of the batches.
        others: recordings of the same sensors in other episodes. The mean of their readings stands
            for those of an input sensor that has none in ``fit``.
    """

    def __init__(
        self,
        fit: Recording,
        validation: Recording,
        inputs: tuple[str, ...],
        lags: int,
        batch: int,
        seed: int,
        others: tuple[Recording, ...] = (),
    ) -> None:
        super().__init__()
        self.fit, self.validation = fit, validation
        self.batch, self.seed = batch, seed
        traces = torch.from_numpy(fit.select(inputs).values)
        if (absent := traces.isnan().all(dim=0)).any():
            known = [torch.from_numpy(other.select(inputs).values) for other in others]
            traces = torch.where(absent, torch.cat(known).nanmean(dim=0), traces)
        self.windows = windows(traces, lags).float().contiguous()
        self.validated = _align(validation, fit)
        fitted = torch.from_numpy(fit.values).clone()
        if validation.names == fit.names:
            fitted[~self.validated.isnan()] = torch.nan
        self.fitted = fitted.float()

    def train_dataloader(self) -> Batches:
        """Return shuffled (windows, fitted values)."""
        tensors = self.windows, self.fitted
        return shuffled_batches(tensors, self.batch, self.seed, Share.of(self.trainer))

    def val_dataloader(self) -> Batches:
        """Return (windows, fitted values, validated values) in order of time."""
        tensors = self.windows, self.fitted, self.validated.float()
        return ordered_batches(tensors, self.batch, Share.of(self.trainer))


class EpisodesDataModule(RecordingDataModule):
    """Several episodes, concatenated; no window spans two episodes.

    Args:
        parts: one module for each episode.
    """

    def __init__(self, parts: Sequence[RecordingDataModule]) -> None:
        LightningDataModule.__init__(self)
        first = parts[0]
        self.batch, self.seed = first.batch, first.seed
        self.windows = torch.cat([part.windows for part in parts])
        self.fitted = torch.cat([part.fitted for part in parts])
        self.validated = torch.cat([part.validated for part in parts])


def _align(validation: Recording, fit: Recording) -> Tensor:
    """Return the validation samples on the fit clock, NaN elsewhere."""
    values = torch.full((len(fit.times), len(validation.sensors)), torch.nan, dtype=torch.float64)
    first = int(fit.times.searchsorted(validation.times[0] - 1e-9))
    values[first : first + len(validation.times)] = torch.from_numpy(validation.values)
    return values
