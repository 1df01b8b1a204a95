"""Follow a localised source from the first part of a record to its end, before any law."""

from __future__ import annotations

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.first_part import FirstPart, explains, follows
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_forcing_nearby
from dashred.inference.hypotheses.sources.find_source import (
    FoundSource,
    best_source,
    refit_source,
)
from dashred.inference.hypotheses.sources.screening import screen_sources
from dashred.inference.hypotheses.sources.smooth_forcing import LinearisedForcing
from dashred.inference.hypotheses.terms_everywhere import TermsEverywhere

# Growth factor of the horizon.
GROWTH = 2.0
# Tolerance of the fits; the last one is repeated with the exact simulator.
TOLERANCE = 0.01


def find_early_source(
    null: LeastSquaresProblem,
    part: FirstPart,
    size: Tensor,
    everywhere: TermsEverywhere,
    candidate_count: int,
    report: Report,
) -> FoundSource | None:
    """Return a source that explains the whole recording within its noise, if there is one.

    Args:
        null: F of the start alone over the whole record.
        part: the first part in which something is missing.
        size: rms of each equation's own tendency, ``(equation,)``.
        everywhere: what the best terms that act everywhere leave over this part. If they explain
            it, and better than a source does, no source is fitted.
        candidate_count: number of terms in the library, for the penalty of the search.
        report: progress.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    total, horizon, problem = len(null.recorded), part.samples, part.null
    if everywhere.explain:
        screened, _ = screen_sources(_mesh(part.forcing), part.forcing.equations, candidate_count)
        if everywhere.cost < min(each.score - each.penalty for each in screened):
            return None
    found = _search(problem, part.phi, part.forcing, size, candidate_count)
    while found is not None and follows(problem, found.fit.chi2):
        level = found.fit.chi2 / problem.noise.count
        report(horizon / total, f"a source over {horizon} of {total} samples, χ²/n {level:.2f}")
        if horizon == total:
            return found if explains(problem, found.fit.chi2) else None
        horizon = min(total, max(horizon + 1, round(GROWTH * horizon)))
        problem, phi = null.truncate(horizon), found.fit.phi
        found = refit_source(problem, found, size, TOLERANCE)
        if not follows(problem, found.fit.chi2):
            # Its course may have looked different over the shorter part.
            forcing = fit_forcing_nearby(problem, phi, size)
            if forcing is None:
                return None
            found = _search(problem, phi, forcing, size, candidate_count)
    return None


def _search(
    problem: LeastSquaresProblem,
    phi: Tensor,
    forcing: FreeForcing,
    size: Tensor,
    candidate_count: int,
) -> FoundSource | None:
    """Return the best source over a part of the record, from a forcing on a coarse mesh."""
    [misfit], _ = problem.values(phi[None])
    mesh = _mesh(forcing)
    return best_source(problem, mesh, forcing, float(misfit), size, candidate_count, TOLERANCE)


def _mesh(forcing: FreeForcing) -> LinearisedForcing:
    """Return the linearised problem of a forcing on its own coarse mesh."""
    return LinearisedForcing(forcing.objective, forcing.block, forcing.normal).without_law()
