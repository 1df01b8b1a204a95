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
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
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
from dashred.physics.expressions.algebra import substitute as put_in
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.system import Term

FUNCTIONS = ("sin", "cos", "tanh", "exp")
# Stands for the constant while it is varied; no name of a system begins so.
K = "_k"
# Of the constant, how far one step may move it, what is close enough, and how a reader is told.
FARTHEST, CLOSE, DIGITS = 0.4, 2e-3, 4
ROUNDS, STEPS, TOLERANCE = 6, 4, 1e-3
# Factors between which a constant is looked for: beyond, one function mimics another by its tail.
REACH = (0.2, 5.0)
# A constant with which F rises by more is none.
ASTRAY = 1.0


@dataclass(frozen=True)
class Tunable:
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

    def at(self, constant: float) -> Tunable:
        """Return the same with another constant."""
        [term] = self.candidate.terms
        moved = Term(term.equation, _inside(self.function, constant, self.operand))
        candidate = replace(self.candidate, name=str(moved), terms=(moved,))
        found = tunable(candidate)
        assert found is not None
        return found


def tunable(candidate: Candidate) -> Tunable | None:
    """Return a candidate with its constant in reach; None for one that has none."""
    if candidate.equation is None or len(candidate.terms) != 1:
        return None
    [term] = candidate.terms
    match term.expression:
        case Call(function, inner) if function in FUNCTIONS:
            constant, operand = split_coefficient(inner)
        case _:
            return None
    open_to_k = call(function, multiply((Name(K), operand)))
    slope = put_in(differentiate(open_to_k, K), {K: Number(constant)})
    beside = Candidate(
        name=f"{candidate.name}, its constant",
        equation=candidate.equation,
        terms=(Term(term.equation, slope),),
        scale=candidate.scale * abs(constant) * FARTHEST,
        is_extended=True,
    )
    return Tunable(candidate, beside, function, operand, constant)


def slopes_of(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the slopes of all candidates that have a constant."""
    return [found.slope for candidate in candidates if (found := tunable(candidate))]


def moved(tuned: Tunable, xi: float, by_constant: float) -> float:
    """Return the constant that two coefficients speak for, not too far from the present one."""
    bound = FARTHEST * abs(tuned.constant)
    shift = by_constant / xi if xi else 0.0
    return float(f"{tuned.constant + min(max(shift, -bound), bound):.{DIGITS}g}")


def within_reach(
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
    least, most = sorted((factor - 1) * constant for factor in REACH)
    at_best = (b * d - a * e) / (a * f - b * e) if a * f != b * e else math.inf
    shifts = [at_best] if least <= at_best <= most else [least, most]
    best = [((a + b * r) / (d + 2 * e * r + f * r * r), r) for r in shifts]
    gain, xi, r = max((xi * (a + b * r), xi, r) for xi, r in best)
    return problem.constant - gain, torch.tensor([xi, r * xi], dtype=torch.float64)


def tune(
    objective: LeastSquaresProblem, begin: Tunable, phi: Tensor
) -> tuple[Candidate, LeastSquaresProblem, FitResult]:
    """Fit a law of one candidate, its constant and the start.

    Args:
        objective: F of any candidates, over the whole record.
        begin: the candidate, with a first constant.
        phi: start and coefficient to begin from, ``(mode + 1,)``.

    Returns:
        the candidate with its constant, F of it alone, and its minimum.
    """
    modes, tuned, known, least = objective.modes, begin, begin, math.inf
    for _ in range(ROUNDS):
        pair = objective.with_candidates([tuned.candidate, tuned.slope])
        fitted = minimise(pair, torch.cat([phi, phi.new_zeros(1)]), STEPS, TOLERANCE)
        if fitted.cost > least + ASTRAY:
            tuned = known
            break
        known, least = tuned, fitted.cost
        xi, by_constant = fitted.phi[modes:].tolist()
        constant = moved(tuned, xi, by_constant)
        close = abs(constant - tuned.constant) <= CLOSE * abs(tuned.constant)
        phi, tuned = fitted.phi[: modes + 1], tuned.at(constant)
        if close:
            break
    alone = objective.with_candidates([tuned.candidate])
    return tuned.candidate, alone, minimise(alone, phi, STEPS, TOLERANCE)


def _inside(function: str, constant: float, operand: Expr) -> Expr:
    return call(function, multiply((Number(constant), operand)))
