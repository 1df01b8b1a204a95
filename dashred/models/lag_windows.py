"""Lagged windows: the input of SHRED's recurrent network at each time."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dashred.core.errors import InputError


def windows(
    traces: Float[Tensor, "*batch time sensor"], lags: int
) -> Float[Tensor, "*batch time lag sensor"]:
    """Return ``s_{t-lags}, …, s_t`` for each t: windows of lags + 1 samples.

    Before the start, the first sample is repeated. Missing values are interpolated first
    (:func:`fill_missing`).

    Raises:
        InputError: a sensor has no values.
    """
    filled = fill_missing(traces)
    first = filled[..., :1, :].expand(*filled.shape[:-2], lags, filled.shape[-1])
    padded = torch.cat((first, filled), dim=-2)
    return padded.unfold(-2, lags + 1, 1).transpose(-1, -2)


def fill_missing(
    traces: Float[Tensor, "*batch time sensor"],
) -> Float[Tensor, "*batch time sensor"]:
    """Replace NaN by linear interpolation in time, or by the nearest sample at the ends.

    Raises:
        InputError: a sensor has no values.
    """
    missing = traces.isnan()
    if not missing.any():
        return traces
    filled = traces.detach().cpu().numpy().copy()
    time = np.arange(traces.shape[-2])
    for batch in np.ndindex(*traces.shape[:-2]):
        for sensor in range(traces.shape[-1]):
            trace = filled[(*batch, slice(None), sensor)]
            known = ~np.isnan(trace)
            if not known.any():
                raise InputError(f"sensor number {sensor + 1} has no values in this time interval")
            trace[:] = np.interp(time, time[known], trace[known])
    return torch.from_numpy(filled).to(traces.device)
