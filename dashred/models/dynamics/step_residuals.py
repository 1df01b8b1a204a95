"""What the error of a step between samples is measured in: the fields, or the latent space."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.models.dynamics.sampled_dynamics import SampledDynamics, Samples

Encode = Callable[[Float[Tensor, "batch lag sensor"]], Float[Tensor, "batch latent"]]

# Std of a latent unit that does not change.
LEAST_SPREAD = 1e-6


class StepResidual(Protocol):
    """The errors of the steps of a block, in units in which q is a share of what varies."""

    def __call__(
        self,
        samples: Samples,
        latent: Float[Tensor, "time latent"],
        fields: Float[Tensor, "time ..."],
        forecast: Float[Tensor, "step ..."],
    ) -> Float[Tensor, "step ..."]:
        """Return the error of each step.

        Args:
            samples: of the block.
            latent: h + T(h) at all its samples.
            fields: û at all its samples, ``(time, field, *grid)``.
            forecast: ũ at all but the first, ``(time - 1, field, *grid)``, float64.
        """


class FieldResidual:
    """``û_{t+Δ} − ũ_{t+Δ}``, in std of each field."""

    def __init__(self, dynamics: SampledDynamics) -> None:
        self._dynamics = dynamics

    def __call__(
        self, samples: Samples, latent: Tensor, fields: Tensor, forecast: Tensor
    ) -> Tensor:
        """Return the error of each step."""
        return self._dynamics.scaled(fields[1:].double() - forecast)


class Histories:
    """``E(v_t)``: the latent state of the recorded history whose last sample v_t gives.

    Args:
        encode: SHRED's encoder, from windows to the latent state.
        windows: of the recording, ``(time, lag, sensor)``.
        operator: H of the sensors that SHRED reads.

    Attributes:
        spread: std of each latent unit over the recording, ``(latent,)``.
    """

    def __init__(self, encode: Encode, windows: Tensor, operator: ObservationOperator) -> None:
        self._encode, self._windows, self._operator = encode, windows, operator
        with torch.no_grad():
            self.spread = encode(windows).std(dim=0).clamp(min=LEAST_SPREAD)

    def latent(
        self, rows: slice, fields: Float[Tensor, "time ..."]
    ) -> Float[Tensor, "time latent"]:
        """Return E of fields at rows of the recording."""
        last = self._operator(fields).to(self._windows)
        return self._encode(torch.cat([self._windows[rows, :-1], last[:, None]], dim=1))


class SearchResidual:
    """``E(û_{t+Δ}) − E(ũ_{t+Δ})``: Algorithm 1 of Bao & Kutz (2025) as a residual."""

    def __init__(self, histories: Histories) -> None:
        self._histories = histories

    def __call__(
        self, samples: Samples, latent: Tensor, fields: Tensor, forecast: Tensor
    ) -> Tensor:
        """Return the error of each step, in std of the latent units."""
        known, later = self._histories, slice(samples.rows.start + 1, samples.rows.stop)
        return (known.latent(later, fields[1:]) - known.latent(later, forecast)) / known.spread


class AdvancingResidual:
    """``G_R(s'_{t+Δ}) − G_R(s'_t) − [G_R(ũ_{t+Δ}) − G_R(û_t)]``: Algorithm 2 as a residual.

    ``G_R`` of a field is the transform of its E.
    """

    def __init__(self, histories: Histories, transform: Callable[[Tensor], Tensor]) -> None:
        self._histories, self._transform = histories, transform

    def __call__(
        self, samples: Samples, latent: Tensor, fields: Tensor, forecast: Tensor
    ) -> Tensor:
        """Return the error of each step, in std of the latent units."""
        known, first, end = self._histories, samples.rows.start, samples.rows.stop
        after = self._transform(known.latent(slice(first + 1, end), forecast))
        before = self._transform(known.latent(slice(first, end - 1), fields[:-1]))
        return (latent.diff(dim=0) - after + before) / known.spread
