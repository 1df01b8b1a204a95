"""Estimates of the corrected SHRED for the samples of a stream."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.models.shred import SHRED

Array = NDArray[np.float64]


class SurrogateStream:
    """Keeps the window of SHRED and reconstructs the field of every sample.

    Args:
        shred: the network.
        lags: number of samples before the present one in a window.
    """

    def __init__(self, shred: SHRED, lags: int) -> None:
        self._shred, self._lags = shred, lags
        self._window: Array | None = None

    def begin_again(self) -> None:
        """Forget the samples; the next one is repeated before it, as in training."""
        self._window = None

    @torch.no_grad()
    def add(self, inputs: Array) -> Array:
        """Return the fields of the next samples.

        The network reads the windows of all of these samples at once. Each window ends at its own
        sample, so no estimate uses a later one.

        Args:
            inputs: readings of the input sensors, ``(time, sensor)``, without NaN.

        Returns:
            ``(time, field, *grid)``, float64.
        """
        if self._window is None:
            self._window = np.repeat(inputs[:1], self._lags, axis=0)
        joined = np.concatenate([self._window, inputs])
        self._window = joined[len(joined) - self._lags :]
        windows = torch.from_numpy(joined).float().unfold(0, self._lags + 1, 1).transpose(1, 2)
        return self._shred(windows).double().numpy()
