"""What the best terms that act everywhere leave over the first part of a record, before any fit."""

from __future__ import annotations

from dataclasses import dataclass

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.first_part import FirstPart
from dashred.inference.hypotheses.windows.screening import profile_out

# One or two terms explain the first part if their F, linearised about a coarse forcing, is below
# this multiple of the number of readings.
ENOUGH = 1.3


@dataclass(frozen=True)
class TermsEverywhere:
    """The best one or two terms that act everywhere, linearised about a coarse forcing.

    Attributes:
        cost: the smallest F.
        count: number of readings.
    """

    cost: float
    count: int

    @property
    def explain(self) -> bool:
        """Whether they explain the first part."""
        return self.cost < ENOUGH * self.count


def best_terms_everywhere(objective: LeastSquaresProblem, part: FirstPart) -> TermsEverywhere:
    """Return what one or two terms that act everywhere leave over the first part.

    Args:
        objective: F of all candidates over the whole record.
        part: the first part in which something is missing.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    first = objective.truncate(part.samples)
    candidates = first.forward_model.law.candidates
    problem = profile_out(first, part.forcing, candidates, first.prior_std)
    singles = [(j,) for j in range(len(candidates))]
    pairs = [(i, j) for j in range(len(candidates)) for i in range(j)]
    least = min(float(problem.costs(sets).min()) for sets in (singles, pairs) if sets)
    return TermsEverywhere(least, first.noise.count)
