"""What the best terms that act everywhere leave over the first part of a record."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import growing_horizon_fits
from dashred.inference.hypotheses.first_part import GROWTH, MIN_EXCESS, FirstPart
from dashred.inference.hypotheses.windows.screening import profile_out

# One or two terms explain the first part if their F, linearised about a coarse forcing, is below
# this multiple of the number of readings.
ENOUGH = 1.3
# They are followed up to this multiple of the first part.
BEYOND = GROWTH**2


@dataclass(frozen=True)
class TermsEverywhere:
    """The best one or two terms that act everywhere, linearised about a coarse forcing.

    Attributes:
        cost: the smallest F.
        count: number of readings.
        members: the terms, as indices of candidates.
        coefficients: their coefficients, ``(term,)``.
    """

    cost: float
    count: int
    members: tuple[int, ...]
    coefficients: Tensor

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
    by_size = [(problem.costs(sets), sets) for sets in (singles, pairs) if sets]
    cost, best = min((float(costs.min()), sets[int(costs.argmin())]) for costs, sets in by_size)
    return TermsEverywhere(cost, first.noise.count, best, problem.coefficients(best))


def follow_beyond(
    objective: LeastSquaresProblem, part: FirstPart, everywhere: TermsEverywhere
) -> bool:
    """Tell whether the best terms everywhere follow the record beyond its first part, up to noise.

    No other cause can explain it better then, up to there.

    Args:
        objective: F of all candidates over the whole record.
        part: the first part in which something is missing.
        everywhere: the best terms over this part.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    samples = min(len(objective.recorded), round(BEYOND * part.samples))
    law = objective.subset(everywhere.members).truncate(samples)
    phi = torch.cat([part.forcing.phi[: objective.modes], everywhere.coefficients])
    fits = growing_horizon_fits(law, phi, part.samples, GROWTH)
    return all(
        fitted.chi2 < law.truncate(len(fitted.readings)).noise.count + MIN_EXCESS for fitted in fits
    )
