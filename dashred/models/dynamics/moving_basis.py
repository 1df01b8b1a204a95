"""The POD basis of an assimilation, which gets modes for what forecasts have outside of it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dashred.models.assimilation import AssimilationSensors
from dashred.models.dynamics.adapter import AdaptedDecoder
from dashred.models.dynamics.sampled_dynamics import SampledDynamics
from dashred.models.pod import POD, oriented
from dashred.models.shred import SHRED

# Modes that an epoch adds at most; RMS of the forecasts that they may leave, as a share of q.
MOST_MODES, NEGLIGIBLE = 48, 0.03


class Outside(NamedTuple):
    """The part of the forecasts that the basis cannot express.

    Attributes:
        rms: in std of a field.
        modes: that express it, orthonormal to the basis, ``(mode, field*grid)``.
        spread: RMS of their coefficients, ``(mode,)``.
        left: what these modes cannot express either, ``(time, field, *grid)``.
    """

    rms: float
    modes: Tensor
    spread: Tensor
    left: Tensor


class MovingBasis:
    """The basis of SHRED, with as many modes as the assimilation needs.

    The basis comes from simulations. A real system leaves it (Bao & Kutz 2025, §6), and the
    simulator with the law that is learnt shows where to.

    Attributes:
        guess: POD coefficients of the background in units of their std, ``(time, mode)``; zero for
            modes that SHRED does not know.
        outside: RMS of what the last forecasts have outside of the basis, in std of a field.

    Args:
        shred: the network whose basis it is. Its decoder begins with the adapter, if there is one.
        sensors: that are fitted. What the basis cannot express is part of the σ of their errors.
        guess: POD coefficients that SHRED gives.
        unexpressed: RMS of what the basis cannot express of the readings, ``(sensor,)``.
    """

    def __init__(
        self, shred: SHRED, sensors: AssimilationSensors, guess: Tensor, unexpressed: Tensor
    ) -> None:
        self.shred, self.sensors, self.guess, self.outside = shred, sensors, guess, 0.0
        self._noise = sensors.noise.clone()
        self._count_as_noise(unexpressed)

    @property
    def adapted(self) -> AdaptedDecoder | None:
        """The decoder with the adapter; None for the frozen decoder alone, whose modes are all."""
        first = self.shred.decoder[0]
        return first if isinstance(first, AdaptedDecoder) else None

    def grow(self, dynamics: SampledDynamics, fields: Float[Tensor, "time ..."], q: float) -> None:
        """Take the modes that the forecasts need, if there is an adapter.

        Args:
            dynamics: the simulator, with the law.
            fields: û, ``(time, field, *grid)``, float64.
            q: model error, in std of a field.
        """
        found = None if self.adapted is None else outside(self.shred.pod, dynamics, fields, q)
        if found is None:
            return
        self.outside = found.rms
        modes = torch.cat([self.shred.pod.modes, found.modes])
        self.resize(modes, torch.cat([self.shred.spread, found.spread]))
        self._count_as_noise(self.sensors.fit(found.left).square().mean(dim=0).sqrt())

    def resize(self, modes: Float[Tensor, "mode cell"], spread: Float[Tensor, " mode"]) -> None:
        """Take modes that begin like those of the basis; the network gives zero for new ones."""
        self.shred.pod, self.shred.spread = self.shred.pod.with_modes(modes), spread
        self.guess = nn.functional.pad(self.guess, (0, len(modes) - self.guess.shape[1]))
        if self.adapted is not None:
            self.adapted.resize(len(modes))

    def _count_as_noise(self, unexpressed: Float[Tensor, " sensor"]) -> None:
        self.sensors.noise = torch.hypot(self._noise, unexpressed.to(self._noise))


@torch.no_grad()
def outside(
    pod: POD, dynamics: SampledDynamics, fields: Float[Tensor, "time ..."], q: float
) -> Outside | None:
    """Return what the forecasts ``Φ_Δ(û_t)`` have outside of the basis; None if one blows up.

    The modes are the leading singular vectors of the forecasts, less their projections on the
    basis.

    Args:
        pod: the basis.
        dynamics: the simulator, with the law.
        fields: û, ``(time, field, *grid)``, float64.
        q: model error, in std of a field; a small share of it may be left.
    """
    forecasts = dynamics.forecasts(fields)
    if not forecasts.isfinite().all():
        return None
    scale = pod.scale.double().reshape(-1, *(1,) * len(pod.grid))
    rest = ((forecasts - pod.decode(pod.encode(forecasts))) / scale).flatten(1)
    _, sizes, vectors = torch.linalg.svd(rest, full_matrices=False)
    # RMS of what no, one, two and more modes leave.
    squares = torch.cat([torch.zeros(1).double(), sizes.square()])
    left = ((squares.sum() - squares.cumsum(0)).clamp(min=0) / rest.numel()).sqrt()
    count = min(int((left > NEGLIGIBLE * q).sum()), MOST_MODES, len(sizes))
    modes, spread = vectors[:count], sizes[:count] / len(rest) ** 0.5
    unexpressed = (rest - rest @ modes.T @ modes).reshape(forecasts.shape) * scale
    # What rounding has left of the basis in the modes is removed; it is float32.
    own = pod.modes.double()
    modes = torch.linalg.qr((modes - modes @ own.T @ own).T).Q
    kind = pod.modes.dtype
    return Outside(float(left[0]), oriented(modes).to(kind), spread.to(kind), unexpressed)
