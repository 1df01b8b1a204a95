"""The fit of an assimilation with dynamics over the states, and what is left of it for the law."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from torch import Tensor

from dashred.core.numerics.block_tridiagonal import Array
from dashred.models.dynamics.gauss_newton import minimise
from dashred.models.dynamics.unknowns import Residuals, Unknowns
from dashred.models.dynamics.weak_constraint import WeakConstraint

# q of the first epoch, in units of the std of a field, at which the weight of the background is 1.
FIRST_ERROR = 0.1
# Eigenvalues below this share of the largest are rounding errors.
LEAST_EIGENVALUE = 1e-13
# Standard deviations by which the loss may exceed what the noise alone would give.
MARGIN = 3.0


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


class Minimum(NamedTuple):
    """The loss for one q, and its minimum for one law.

    Attributes:
        loss: the loss.
        error: q, in std of a field.
        fitted: its minimum.
    """

    loss: StateFit
    error: float
    fitted: Fitted

    @property
    def is_consistent(self) -> bool:
        """Whether noise explains the loss.

        With the right law, both misfits of n readings are 1, but for fluctuations of √(2/n), and
        the steps hardly add to them. A larger loss means that the readings contradict the
        simulator with this law.
        """
        limit = 2 * (1 + MARGIN * math.sqrt(2 / self.loss.problem.count))
        return self.fitted.parts["train"] <= limit

    def with_law(self, coefficients: Tensor) -> Minimum:
        """Return the minimum with another law, from the states of this one.

        Args:
            coefficients: of all terms, ``(term,)``; those that are not zero are fitted.
        """
        self.loss.problem.dynamics.set_law(coefficients)
        return self.loss.fit(self.fitted.unknowns.states, self.error)


class StateFit:
    """Minimise the loss over POD coefficients and the law of the simulator.

    Args:
        problem: the loss.
        is_over: whether the time is up.
    """

    def __init__(self, problem: WeakConstraint, is_over: Callable[[], bool]) -> None:
        self.problem, self.is_over = problem, is_over

    def fit(self, start: Float[Tensor, "time mode"], error: float) -> Minimum:
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
        fitted = Fitted(unknowns, coefficients, _parts(residuals, self.problem.count))
        return Minimum(self, error, fitted)

    def law_equations(self, at: Unknowns, error: float) -> tuple[Array, Array, float] | None:
        """Return G, g and c of the loss, ``c - 2 gᵀδξ + δξᵀ G δξ``, linearised at a point.

        The loss is that of all readings, and the states follow the law. δξ is the change of the
        coefficients of all terms in units of their scales. None where rounding has left the normal
        equations without a Cholesky factor.

        Raises:
            OutOfTimeError: the time is up.
        """
        terms = range(len(at.law))
        equations = self.problem.equations(at, terms, error, _weight(error), self.is_over)
        profiled = equations.profiled()
        if profiled is None:
            return None
        gram, target, cost = profiled
        return _bounded(gram, self.problem.precision), target, cost


def _weight(error: float) -> float:
    """Return the weight of the background.

    The errors of SHRED at neighbouring samples are alike, so that its estimate counts less than as
    many readings; and the better the steps fit, the less it is needed.
    """
    return (error / FIRST_ERROR) ** 2


def _bounded(gram: Array, precision: float) -> Array:
    """Return G with no eigenvalue below the precision of the prior, but for rounding errors."""
    values, vectors = np.linalg.eigh(gram)
    least = max(precision, LEAST_EIGENVALUE * float(values.max()))
    bounded: Array = vectors * values.clip(min=least) @ vectors.T
    return bounded


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
