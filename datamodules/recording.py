"""The real recording as windows and targets: sensor values are all there is to ask for."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from lightning import LightningDataModule
from torch import Tensor

from dashred.data.recording import Recording
from dashred.models.lag_windows import windows
from datamodules.batches import Batches, ordered_batches, shuffled_batches


class RecordingDataModule(LightningDataModule):
    """What assimilation is fitted to, and what stops it.

    Test sensors and held-out times never get here: the constructor is handed the fit and the
    validation parts of the split alone. There is no field in a recording, so none can be asked.

    Attributes:
        windows: histories s' of SHRED's input sensors, ``(time, lag, sensor)``, float32.
        fitted: what the p + q fit sensors read, ``(time, sensor)``, NaN where missing.
        validated: what the validation sensors read, ``(time, sensor)``, NaN where missing or,
            where no sensor validates, before the validation stretch.

    Args:
        fit: recording of the fit sensors; its times are the module's clock.
        validation: recording of the validation sensors, or of a later stretch of the fit ones.
        inputs: names of the fit sensors that SHRED sees.
        lags: samples of history behind the present one.
        batch: windows in a batch.
        seed: of the batches' order.
    """

    def __init__(
        self,
        fit: Recording,
        validation: Recording,
        inputs: tuple[str, ...],
        lags: int,
        batch: int,
        seed: int,
    ) -> None:
        super().__init__()
        self.fit, self.validation = fit, validation
        self.batch, self.seed = batch, seed
        seen = torch.from_numpy(fit.select(inputs).values)
        self.windows = windows(seen, lags).float().contiguous()
        self.validated = _on_clock(validation, fit)
        fitted = torch.from_numpy(fit.values).clone()
        if validation.names == fit.names:
            fitted[~self.validated.isnan()] = torch.nan
        self.fitted = fitted.float()

    def train_dataloader(self) -> Batches:
        """Return shuffled (windows, fitted values)."""
        return shuffled_batches((self.windows, self.fitted), self.batch, self.seed)

    def val_dataloader(self) -> Batches:
        """Return (windows, fitted values, validated values) in order of time."""
        return ordered_batches((self.windows, self.fitted, self.validated.float()), self.batch)


class EpisodesDataModule(RecordingDataModule):
    """Several episodes one after another; each has windows of its own, and none spans two.

    Args:
        parts: the episodes.
    """

    def __init__(self, parts: Sequence[RecordingDataModule]) -> None:
        LightningDataModule.__init__(self)
        first = parts[0]
        self.batch, self.seed = first.batch, first.seed
        self.windows = torch.cat([part.windows for part in parts])
        self.fitted = torch.cat([part.fitted for part in parts])
        self.validated = torch.cat([part.validated for part in parts])


def _on_clock(validation: Recording, fit: Recording) -> Tensor:
    """Put the validation samples on the fit clock, NaN elsewhere."""
    values = torch.full((len(fit.times), len(validation.sensors)), torch.nan, dtype=torch.float64)
    first = int(fit.times.searchsorted(validation.times[0] - 1e-9))
    values[first : first + len(validation.times)] = torch.from_numpy(validation.values)
    return values
