"""Prior distributions of the start, as maps from standard normal variables z."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

# Gauss–Newton steps of a projection, and the step of its finite differences.
PROJECTION_STEPS, DIFFERENCE = 4, 1e-5


class StartModel(Protocol):
    """A prior on starts: ``u₀ = start(z)`` with z ~ N(0, I).

    See docs/method.md#fit-through-the-simulator.

    A fit determines z. The model therefore gives both the first guess (z = 0) and its scale.
    An example is :class:`dashred.physics.runs.initial_state_prior.StartPrior`, which is not affine.
    """

    @property
    def size(self) -> int:
        """Number of independent standard normals z."""

    def start(self, z: Tensor) -> Tensor:
        """Return the starts ``(batch, field, *grid)`` for ``z``, ``(batch, size)``."""


@dataclass(frozen=True)
class LinearStart:
    """The start ``u₀ = m + B z`` of an estimate with mean m and modes B.

    Attributes:
        mean: m, ``(field, *grid)``.
        modes: B, ``(mode, field, *grid)``; ``Σ_k B_k ⊗ B_k`` is the covariance of u₀.
    """

    mean: Float[Tensor, "field ..."]
    modes: Float[Tensor, "mode field ..."]

    def __post_init__(self) -> None:
        """Check that the modes and the mean have the same state shape."""
        if self.modes.shape[1:] != self.mean.shape:
            shapes = f"{tuple(self.modes.shape)} do not fit the mean {tuple(self.mean.shape)}"
            raise ValueError(f"modes {shapes}")

    @property
    def size(self) -> int:
        """Number of independent standard normals z."""
        return len(self.modes)

    def start(self, z: Tensor) -> Tensor:
        """Return the starts ``(batch, field, *grid)`` for ``z``, ``(batch, size)``."""
        return self.mean + torch.tensordot(z, self.modes, dims=1)


@dataclass(frozen=True)
class ScaledStart:
    """A start model with its spread multiplied: ``u₀ = start(factor·z)``.

    Attributes:
        model: the original model.
        factor: factor on the spread.
    """

    model: StartModel
    factor: float

    @property
    def size(self) -> int:
        """Number of independent standard normals z."""
        return self.model.size

    def start(self, z: Tensor) -> Tensor:
        """Return the starts ``(batch, field, *grid)`` for ``z``, ``(batch, size)``."""
        return self.model.start(self.factor * z)

    def draw(self, count: int, rng: np.random.Generator) -> Tensor:
        """Return ``count`` random starts."""
        return self.start(torch.from_numpy(rng.standard_normal((count, self.size))))


def project_state(model: StartModel, state: Tensor) -> Tensor:
    """Return the z whose start is nearest to a state, ``(mode,)``, by Gauss–Newton steps.

    Args:
        model: u₀(z).
        state: ``(field, *grid)``.
    """
    z = torch.zeros(model.size, dtype=torch.float64)
    eye = DIFFERENCE * torch.eye(model.size, dtype=torch.float64)
    for _ in range(PROJECTION_STEPS):
        base = model.start(z[None])
        slope = ((model.start(z + eye) - base) / DIFFERENCE).flatten(1).T
        rest = (state - base[0]).flatten()[:, None]
        z = z + torch.linalg.lstsq(slope, rest, driver="gelsd").solution[:, 0]
    return z
