"""Fit of the constant k of a function: ``sin(k u)``, ``cos(k u)``, ``tanh(k u)``, ``exp(k u)``.

``f(k v)`` and its slope ``∂f/∂k`` are two candidates. A fit of both gives their coefficients ξ and
ξ_k, and the next constant is ``k + ξ_k/ξ``. This is a Gauss-Newton iteration in k, and each step is
a fit of the law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.physics.expressions.algebra import (
    Call,
    Expr,
    Name,
    Number,
    call,
    multiply,
    split_coefficient,
    substitute,
)
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.system import Term

FUNCTIONS = ("sin", "cos", "tanh", "exp")
# Placeholder name of the constant; names of a system never begin with an underscore.
CONSTANT_NAME = "_k"
# Largest relative step of the constant, relative step at convergence, and digits of the result.
MAX_STEP, CONVERGED, DIGITS = 0.4, 2e-3, 4
ROUNDS, STEPS, TOLERANCE = 6, 4, 1e-3
# Range of the constant, relative to the value in the library of functions. Beyond it one
# function imitates another.
FACTOR_BOUNDS = (0.2, 5.0)
# A step that increases F by more than this is rejected.
MAX_RISE = 1.0


@dataclass(frozen=True)
class TunableTerm:
    """A candidate ``f(k v)``.

    Attributes:
        candidate: the candidate.
        slope: ``∂f/∂k``, per unit of the candidate's coefficient.
        function: f.
        operand: v.
        constant: k.
    """

    candidate: Candidate
    slope: Candidate
    function: str
    operand: Expr
    constant: float

    @property
    def family(self) -> tuple[str | None, str, Expr]:
        """Key of the candidates that differ only in k."""
        return self.candidate.equation, self.function, self.operand

    def at(self, constant: float) -> TunableTerm:
        """Return this term with another constant."""
        [term] = self.candidate.terms
        expression = call(self.function, multiply((Number(constant), self.operand)))
        new_term = Term(term.equation, expression)
        candidate = replace(self.candidate, name=str(new_term), terms=(new_term,))
        tunable_term = parse_tunable_term(candidate)
        assert tunable_term is not None
        return tunable_term


def parse_tunable_term(candidate: Candidate) -> TunableTerm | None:
    """Return a candidate as a function of a constant; None if it is not one."""
    if candidate.equation is None or len(candidate.terms) != 1:
        return None
    [term] = candidate.terms
    match term.expression:
        case Call(function, inner) if function in FUNCTIONS:
            constant, operand = split_coefficient(inner)
        case _:
            return None
    with_free_constant = call(function, multiply((Name(CONSTANT_NAME), operand)))
    slope = substitute(
        differentiate(with_free_constant, CONSTANT_NAME), {CONSTANT_NAME: Number(constant)}
    )
    slope_candidate = Candidate(
        name=f"slope of {candidate.name}",
        equation=candidate.equation,
        terms=(Term(term.equation, slope),),
        scale=candidate.scale * abs(constant) * MAX_STEP,
        is_extended=True,
    )
    return TunableTerm(candidate, slope_candidate, function, operand, constant)


def build_slopes(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the slopes ``∂f/∂k`` of all candidates that have a constant."""
    return [term.slope for candidate in candidates if (term := parse_tunable_term(candidate))]


def next_constant(term: TunableTerm, xi: float, xi_k: float) -> float:
    """Return the constant ``k + ξ_k/ξ`` after one step, which is bounded and rounded."""
    bound = MAX_STEP * abs(term.constant)
    shift = xi_k / xi if xi else 0.0
    return float(f"{term.constant + min(max(shift, -bound), bound):.{DIGITS}g}")


def solve_within_bounds(
    problem: ProfiledProblem, places: tuple[int, ...], constant: float
) -> tuple[float, Tensor]:
    """Return the minimum of F and its ξ, ξ_k on the linearised problem, with a bounded constant.

    With ``ξ_k = r ξ`` and the best ξ, ``F(r) = c - (a + b r)²/(d + 2 e r + f r²)``. This function
    has one minimum. If it lies out of bounds, one of the two ends is best.

    Args:
        problem: the linearised problem.
        places: columns of the candidate and of its slope.
        constant: the present constant.
    """
    index = list(places)
    a, b = problem.target[index].tolist()
    (d, e), (_, f) = (problem.gram[index][:, index] + torch.diag(problem.precision[index])).tolist()
    least, most = sorted((factor - 1) * constant for factor in FACTOR_BOUNDS)
    optimum = (b * d - a * e) / (a * f - b * e) if a * f != b * e else math.inf
    shifts = [optimum] if least <= optimum <= most else [least, most]
    best = [((a + b * r) / (d + 2 * e * r + f * r * r), r) for r in shifts]
    gain, xi, r = max((xi * (a + b * r), xi, r) for xi, r in best)
    return problem.constant - gain, torch.tensor([xi, r * xi], dtype=torch.float64)


def fit_constant(
    objective: LeastSquaresProblem, begin: TunableTerm, phi: Tensor
) -> tuple[Candidate, LeastSquaresProblem, FitResult]:
    """Fit a law of one candidate together with its constant and the initial state.

    Args:
        objective: F of any candidates, over the whole record.
        begin: the candidate with a first constant.
        phi: initial state and coefficient at which the fit begins, ``(mode + 1,)``.

    Returns:
        The candidate with its fitted constant, F of this candidate alone, and the minimum of F.
    """
    modes, term, previous, least = objective.modes, begin, begin, math.inf
    for _ in range(ROUNDS):
        pair = objective.with_candidates([term.candidate, term.slope])
        fitted = minimise(pair, torch.cat([phi, phi.new_zeros(1)]), STEPS, TOLERANCE)
        if fitted.cost > least + MAX_RISE:
            term = previous
            break
        previous, least = term, fitted.cost
        xi, xi_k = fitted.phi[modes:].tolist()
        constant = next_constant(term, xi, xi_k)
        is_converged = abs(constant - term.constant) <= CONVERGED * abs(term.constant)
        phi, term = fitted.phi[: modes + 1], term.at(constant)
        if is_converged:
            break
    alone = objective.with_candidates([term.candidate])
    return term.candidate, alone, minimise(alone, phi, STEPS, TOLERANCE)
