"""Terms whose coefficients are known within a covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import System, Term


@dataclass(frozen=True)
class UncertainTerms:
    """Deviations of the coefficients of a law, ``δ ~ N(0, Σ)``, for the members of an ensemble.

    Attributes:
        terms: terms of the law, with lets and parameters resolved.
        coefficient_of: index of the coefficient of each term; terms may share one.
        covariance: Σ, ``(coefficient, coefficient)``.
    """

    terms: Sequence[Term]
    coefficient_of: Sequence[int]
    covariance: Tensor

    @property
    def identity(self) -> list[object]:
        """See :class:`.ensemble.ModelErrors`."""
        return [*map(str, self.terms), list(self.coefficient_of), self.covariance.tolist()]

    def draw(
        self,
        system: System,
        nominal: Tensor,
        times: Tensor,
        members: int,
        rng: np.random.Generator,
    ) -> Forcing:
        """See :class:`.ensemble.ModelErrors`."""
        variances, directions = torch.linalg.eigh(self.covariance)
        factor = directions * variances.clamp(min=0).sqrt()
        normal = rng.standard_normal((members, len(factor)))
        deviations = torch.from_numpy(normal) @ factor.T
        return Forcing(tuple(self.terms), deviations[:, list(self.coefficient_of)])
