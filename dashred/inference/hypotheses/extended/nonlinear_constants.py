"""A function's own constant, fitted: k of ``sin(k u)``, ``tanh(k u)``, ``exp(k u)``.

``f(k v)`` and its slope ``∂f/∂k`` are two candidates; fitted together their coefficients ξ, ξ_k say
how far k is off, ``k + ξ_k/ξ``: Gauss-Newton in k, of which every step is a fit of the law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import Fitted, minimise
from dashred.inference.fit.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.physics.expressions.algebra import (
    Call,
    Expr,
    Name,
    Number,
    call,
    multiply,
    split_coefficient,
)
from dashred.physics.expressions.algebra import substitute as substitute
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.system import Term

FUNCTIONS = ("sin", "cos", "tanh", "exp")
# Stands for the constant while it is varied; no name of a system begins so.
CONSTANT_NAME = "_k"
# Of the constant, how far one step may move it, what is close enough, and how a reader is told.
MAX_STEP, CONVERGED, DIGITS = 0.4, 2e-3, 4
ROUNDS, STEPS, TOLERANCE = 6, 4, 1e-3
# Factors between which a constant is looked for: beyond, one function mimics another by its tail.
FACTOR_BOUNDS = (0.2, 5.0)
# A constant with which F rises by more is none.
MAX_RISE = 1.0


@dataclass(frozen=True)
class TunableTerm:
    """A candidate ``f(k v)``.

    Attributes:
        candidate: it.
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
        """What candidates have in common that differ in k alone."""
        return self.candidate.equation, self.function, self.operand

    def at(self, constant: float) -> TunableTerm:
        """Return the same with another constant."""
        [term] = self.candidate.terms
        next_constant = Term(term.equation, _inside(self.function, constant, self.operand))
        candidate = replace(self.candidate, name=str(next_constant), terms=(next_constant,))
        found = parse_tunable_term(candidate)
        assert found is not None
        return found


def parse_tunable_term(candidate: Candidate) -> TunableTerm | None:
    """Return a candidate with its constant in reach; None for one that has none."""
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
        name=f"{candidate.name}, its constant",
        equation=candidate.equation,
        terms=(Term(term.equation, slope),),
        scale=candidate.scale * abs(constant) * MAX_STEP,
        extended=True,
    )
    return TunableTerm(candidate, slope_candidate, function, operand, constant)


def build_slopes(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the slopes of all candidates that have a constant."""
    return [found.slope for candidate in candidates if (found := parse_tunable_term(candidate))]


def next_constant(term: TunableTerm, xi: float, by_constant: float) -> float:
    """Return the constant that two coefficients speak for, not too far from the present one."""
    bound = MAX_STEP * abs(term.constant)
    shift = by_constant / xi if xi else 0.0
    return float(f"{tuned.constant + min(max(shift, -bound), bound):.{DIGITS}g}")


def solve_within_bounds(
    problem: ProfiledProblem, places: tuple[int, ...], constant: float
) -> tuple[float, Tensor]:
    """Return F and ξ, ξ_k of the linearised problem, the constant within reach.

    With ``ξ_k = r ξ`` and ξ at its best ``F(r) = c - (a + b r)²/(d + 2 e r + f r²)``, which has one
    minimum; where that is out of reach, one end is best.

    Args:
        problem: the linearised problem.
        places: of the candidate and of its slope.
        constant: the present one.
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
) -> tuple[Candidate, LeastSquaresProblem, Fitted]:
    """Fit a law of one candidate, its constant and the start.

    Args:
        objective: F of any candidates, over the whole record.
        begin: the candidate, with a first constant.
        phi: start and coefficient to begin from, ``(mode + 1,)``.

    Returns:
        the candidate with its constant, F of it alone, and its minimum.
    """
    modes, term, previous, least = objective.modes, begin, begin, math.inf
    for _ in range(ROUNDS):
        pair = objective.of([term.candidate, term.slope])
        fitted = minimise(pair, torch.cat([phi, phi.new_zeros(1)]), STEPS, TOLERANCE)
        if fitted.cost > least + MAX_RISE:
            term = previous
            break
        previous, least = term, fitted.cost
        xi, by_constant = fitted.phi[modes:].tolist()
        constant = next_constant(term, xi, by_constant)
        is_converged = abs(constant - term.constant) <= CONVERGED * abs(term.constant)
        phi, term = fitted.phi[: modes + 1], term.at(constant)
        if is_converged:
            break
    alone = objective.of([term.candidate])
    return term.candidate, alone, minimise(alone, phi, STEPS, TOLERANCE)


def _inside(function: str, constant: float, operand: Expr) -> Expr:
    return call(function, multiply((Number(constant), operand)))
