"""Search for a localised source that explains what the simulator lacks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.result import MAX_EXPLAINED_CHI2
from dashred.inference.hypotheses.sources.courses import Periodic
from dashred.inference.hypotheses.sources.screening import (
    ScreenedSource,
    screen_sources,
    widest_bump,
)
from dashred.inference.hypotheses.sources.smooth_forcing import (
    LinearisedForcing,
    linearise_fine_forcing,
)
from dashred.inference.hypotheses.sources.source_fit import TOLERANCE, SourceFit, fit_source
from dashred.inference.hypotheses.windows.screening import profile_out
from dashred.physics.expressions.algebra import Expr, multiply
from dashred.physics.system import Term

# A source has to explain this share of the misfit beyond noise, on the coarse mesh and in a fit.
MIN_SCREENED_SHARE, MIN_EXPLAINED_SHARE = 0.5, 0.9
# A kind of source is fitted if it explains at most this share of the misfit less than the best. Its
# fit may lower the score, because the mesh is coarser than a bump.
NEAR = 0.05
# The first fit of a source ends when its bump is wider than this multiple of the widest local bump.
# Such a source is hardly local, and each further step takes a Jacobian.
LARGEST_WIDTH_RATIO = 3.0


@dataclass(frozen=True)
class FoundSource:
    """A source that explains most of what the simulator lacks.

    Attributes:
        fit: the fit of the source and the start, without a law.
        penalty: penalty for its unknowns and for the search.
        share: share of the misfit beyond noise that it explains.
    """

    fit: SourceFit
    penalty: float
    share: float

    @property
    def score(self) -> float:
        """F plus the penalty."""
        return self.fit.cost + self.penalty


def find_source(
    null: LeastSquaresProblem,
    null_phi: Tensor,
    forcing: FreeForcing,
    size: Tensor,
    candidate_count: int,
) -> FoundSource | None:
    """Return the best source; None if no source explains most of the misfit, or if it is wide.

    Args:
        null: F of the start alone.
        null_phi: its minimum, ``(mode,)``.
        forcing: a free forcing that explains the recording, on top of a law or of none.
        size: rms of each equation's own tendency, ``(equation,)``.
        candidate_count: number of terms tried before, for the penalty of the search.
    """
    if not null.forward_model.simulator.system.axes:
        return None
    [misfit], _ = null.values(null_phi[None])
    count = null.noise.count
    equations = forcing.equations
    if forcing.block.basis.is_nodal:
        # A coarse mesh costs nothing, because it is linearised already.
        coarse = LinearisedForcing(forcing.objective, forcing.block, forcing.normal).without_law()
        if not _is_compact(*screen_sources(coarse, equations, candidate_count), count):
            return None
    fine = linearise_fine_forcing(forcing).without_law()
    return best_source(null, fine, forcing, float(misfit), size, candidate_count)


def best_source(
    null: LeastSquaresProblem,
    mesh: LinearisedForcing,
    forcing: FreeForcing,
    misfit: float,
    size: Tensor,
    candidate_count: int,
    tolerance: float = TOLERANCE,
) -> FoundSource | None:
    """Return the best source on a mesh, fitted; None as in :func:`find_source`.

    Args:
        null: F of the start alone.
        mesh: the linearised problem of a forcing without a law.
        forcing: the forcing about whose trajectory it is linearised.
        misfit: the minimum of F of the start alone.
        size: rms of each equation's own tendency, ``(equation,)``.
        candidate_count: number of terms tried before, for the penalty of the search.
        tolerance: of the fits.
    """
    system, count = null.forward_model.simulator.system, null.noise.count
    screened, constant = screen_sources(mesh, forcing.equations, candidate_count)
    if not _is_compact(screened, constant, count):
        return None
    bound = screened[0].score + NEAR * (constant - screened[0].score)
    promising = [each for each in screened if each.score < bound]
    fit, penalty = _best_fit(null, forcing.phi[: null.modes], promising, size, tolerance)
    if fit.source.bump.width > widest_bump(system):
        return None
    share = 1 - max(fit.chi2 - count, 0.0) / max(misfit - count, 1.0)
    return FoundSource(fit, penalty, share) if share > MIN_EXPLAINED_SHARE else None


def refit_source(
    null: LeastSquaresProblem, found: FoundSource, size: Tensor, tolerance: float = TOLERANCE
) -> FoundSource:
    """Return a source refitted to other samples.

    Args:
        null: F of the start alone, with these samples.
        found: the source.
        size: rms of each equation's own tendency, ``(equation,)``.
        tolerance: of the fit.
    """
    fit = fit_source(null, found.fit.phi, found.fit.source, size, tolerance)
    return replace(found, fit=fit)


def _best_fit(
    null: LeastSquaresProblem,
    phi: Tensor,
    screened: Sequence[ScreenedSource],
    size: Tensor,
    tolerance: float,
) -> tuple[SourceFit, float]:
    """Return the fit of the best source and its penalty; the plainest courses are fitted first.

    No further course is fitted if one explains the recording. If the best fit is local and does not
    explain it, the fits that ended with a wide bump go on, because they might become better.
    """
    widest = widest_bump(null.forward_model.simulator.system)
    limit = LARGEST_WIDTH_RATIO * widest
    fits: list[tuple[SourceFit, float]] = []
    for each in sorted(screened, key=lambda each: each.penalty):
        fits.append((fit_source(null, phi, each.source, size, tolerance, limit), each.penalty))
        if fits[-1][0].chi2 < MAX_EXPLAINED_CHI2 * null.noise.count:
            break
    best, penalty = min(fits, key=_score)
    is_explained = best.chi2 < MAX_EXPLAINED_CHI2 * null.noise.count
    is_local = best.source.bump.width <= widest
    if is_local and not is_explained:
        fits = [
            (fit_source(null, fit.phi, fit.source, size, tolerance), of_fit)
            if fit.source.bump.width > limit
            else (fit, of_fit)
            for fit, of_fit in fits
        ]
        best, penalty = min(fits, key=_score)
    course = best.source.course
    if isinstance(course, Periodic) and course.harmonics > 1:
        faster, amplitudes = course.second_harmonic(best.source.amplitudes)
        source = replace(best.source, course=faster, amplitudes=amplitudes)
        largest = math.inf if is_local else limit
        fit = fit_source(null, best.phi, source, size, tolerance, largest)
        fits.append((fit, penalty - 2 * _penalty_of_one(null)))
    return min(fits, key=_score)


def _score(fitted: tuple[SourceFit, float]) -> float:
    """Return F plus the penalty."""
    return fitted[0].cost + fitted[1]


def _penalty_of_one(null: LeastSquaresProblem) -> float:
    """Return the penalty for one amplitude."""
    return math.log(null.noise.effective_count)


def _is_compact(screened: Sequence[ScreenedSource], constant: float, count: int) -> bool:
    """Return whether a source explains enough of the misfit beyond noise on a mesh."""
    least = min(found.score - found.penalty for found in screened)
    if screened[0].score > constant:
        return False
    return constant - least > MIN_SCREENED_SHARE * (constant - count) > 0


def rival_score(
    full_problem: LeastSquaresProblem, found: FoundSource, forcing: FreeForcing
) -> float:
    """Return the smallest linearised F of a single term that acts where the source is.

    Args:
        full_problem: F of all candidates.
        found: the source.
        forcing: a free forcing that explains the recording.
    """
    system, source = full_problem.forward_model.simulator.system, found.fit.source
    equation = system.fields[source.equation]
    bump = system.parse(source.bump.text(system), f"library.{equation}", equation=equation)
    candidates = full_problem.forward_model.law.candidates
    local = [_in_region(candidate, bump) for candidate in candidates]
    problem = profile_out(full_problem, forcing, local, full_problem.prior_std)
    return float(problem.costs([(j,) for j in range(len(local))]).min())


def _in_region(candidate: Candidate, bump: Expr) -> Candidate:
    """Return a candidate multiplied by a bump."""
    terms = tuple(Term(t.equation, multiply((bump, t.expression))) for t in candidate.terms)
    return replace(candidate, terms=terms, in_program=False)
