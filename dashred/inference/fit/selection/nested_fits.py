"""Compare the fit of a law with that of all candidates, in which it is nested."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import fdtrc
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.selection.stepwise_selection import RefittedSet

# A smaller decrease of F changes no interval and no comparison of scores visibly.
LEAST_DECREASE = 1.0
# The misfit of all candidates is significantly below that of a law if noise alone gives such a
# difference with a smaller probability.
SIGNIFICANCE = 0.05


@dataclass(frozen=True)
class RoomLeft:
    """What a fit could still gain.

    Attributes:
        decrease: by how much F of the law's own unknowns decreases in its quadratic model.
        chance: probability that noise alone gives all candidates such a lower misfit, or a still
            lower one.
    """

    decrease: float
    chance: float

    @property
    def is_fitted(self) -> bool:
        """Whether the fit of the law has ended."""
        return self.decrease < LEAST_DECREASE

    @property
    def is_insignificant(self) -> bool:
        """Whether the law is fitted, and what all candidates gain may be noise."""
        return self.is_fitted and self.chance > SIGNIFICANCE


def room_left(objective: LeastSquaresProblem, law: RefittedSet, free: Tensor) -> RoomLeft:
    """Return what the fit of a law, and that of all candidates, could still gain.

    With χ² and the effective number of parameters k of the law, χ₀² and γ of all candidates, and n
    readings, the F-test of nested models compares ``(χ² - χ₀²)/(γ - k)`` with ``χ₀²/(n - γ)``
    (Seber & Lee, *Linear regression analysis*, 2003, ch. 4). The level of the noise cancels.

    Args:
        objective: F of all candidates.
        law: the fit of the law.
        free: readings of the fit of all candidates, ``(time, sensor)``.
    """
    normal = objective.linearise(law.phi)
    own = objective.indices(law.members)
    lowest = normal.minimum_over(own)
    chi2 = float(normal.residuals.square().sum())
    decrease = chi2 + float(objective.penalty(law.phi)) - lowest
    least = float(objective.residuals(free).square().sum())
    used = normal.effective_parameters(own)
    used_by_all = normal.effective_parameters(range(len(law.phi)))
    more = max(used_by_all - used, 1.0)
    rest = max(objective.noise.count - used_by_all, 1.0)
    ratio = max(chi2 - least, 0.0) / more / max(least / rest, 1e-300)
    chance = float(fdtrc(more, rest, ratio)) if normal.is_finite else 0.0
    return RoomLeft(decrease, chance)
