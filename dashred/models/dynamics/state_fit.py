"""The fit of an assimilation with dynamics over the states, and what is left of it for the law."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.models.dynamics.gauss_newton import minimise
from dashred.models.dynamics.weak_constraint import Residuals, Unknowns, WeakConstraint

# q of the first epoch, in units of the std of a field, at which the weight of the background is 1.
FIRST_ERROR = 0.1
# Eigenvalues below this share of the largest are rounding errors.
LEAST_EIGENVALUE = 1e-13


class Fitted(NamedTuple):
    """The minimum for one law.

    Attributes:
        unknowns: POD coefficients, and coefficients of the law in units of the scales.
        coefficients: of all terms, in their units, ``(term,)``; zero outside of the law.
        parts: of the loss, per reading.
    """

    unknowns: Unknowns
    coefficients: Tensor
    parts: dict[str, float]


class LawEquations(NamedTuple):
    """The loss times the number of readings as a function of the law, ``c + 2 gᵀξ + ξᵀ G ξ``.

    ξ is in units of the scales. The states follow it.

    Attributes:
        matrix: G, ``(term, term)``.
        gradient: g, ``(term,)``.
        precision: of the prior of a coefficient; it is part of G.
    """

    matrix: Tensor
    gradient: Tensor
    precision: float


class StateFit:
    """Minimise the loss over POD coefficients and the law of the simulator.

    Args:
        problem: the loss.
        is_over: whether the time is up.
    """

    def __init__(self, problem: WeakConstraint, is_over: Callable[[], bool]) -> None:
        self.problem, self.is_over = problem, is_over

    def fit(self, start: Float[Tensor, "time mode"], error: float) -> Fitted:
        """Return the minimum with the present terms of the law, and let the simulator have it.

        Args:
            start: states at which the fit begins.
            error: q, in std of a field.
        """
        dynamics = self.problem.dynamics
        begin = Unknowns(start, dynamics.coefficients.detach() / dynamics.scales)
        terms = dynamics.support.nonzero().flatten().tolist()
        unknowns, residuals = minimise(
            self.problem, begin, terms, error, _weight(error), self.is_over
        )
        coefficients = unknowns.law * dynamics.scales
        dynamics.set_law(coefficients)
        return Fitted(unknowns, coefficients, _parts(residuals, self.problem.count))

    def law_equations(self, at: Unknowns, error: float) -> LawEquations:
        """Return the loss as a function of the coefficients of all terms, linearised at a point.

        Raises:
            OutOfTimeError: the time is up.
        """
        terms = range(len(at.law))
        equations = self.problem.equations(at, terms, error, _weight(error), self.is_over)
        matrix, gradient = equations.eliminated()
        precision = self.problem.precision
        return LawEquations(_bounded(matrix, precision), gradient - matrix @ at.law, precision)


def _weight(error: float) -> float:
    """Return the weight of the background.

    The errors of SHRED at neighbouring samples are alike, so that its estimate counts less than as
    many readings; and the better the steps fit, the less it is needed.
    """
    return (error / FIRST_ERROR) ** 2


def _bounded(matrix: Tensor, precision: float) -> Tensor:
    """Return G with no eigenvalue below the precision of the prior, but for rounding errors."""
    values, vectors = torch.linalg.eigh(matrix)
    least = max(precision, LEAST_EIGENVALUE * float(values.max()))
    return vectors * values.clamp(min=least) @ vectors.T


def _parts(residuals: Residuals, count: int) -> dict[str, float]:
    """Return the loss and its parts, per reading."""
    parts = {
        name: float(part.square().sum()) / count
        for name, part in {
            "misfit": residuals.misfit,
            "forecast_misfit": residuals.forecast_misfit,
            "step_error": residuals.step,
            "background": residuals.background,
            "start": residuals.start,
            "law": residuals.law,
        }.items()
    }
    return {"train": sum(parts.values()), **parts}
