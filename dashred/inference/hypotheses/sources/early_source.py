"""Search for a localised source over a growing horizon, before any law is selected.

A fit of all candidates follows the recording with the wrong terms if a source is missing, and takes
most of the time of a run for that. A source has a handful of unknowns, so that the question is
cheap: a few Jacobians over the first part of the record, and some of few columns over the rest.
"""

from __future__ import annotations

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import growing_horizon_fits
from dashred.inference.hypotheses.free_forcing import fit_free_forcing
from dashred.inference.hypotheses.sources.find_source import (
    FoundSource,
    best_source,
    refit_source,
)
from dashred.inference.hypotheses.sources.smooth_forcing import LinearisedForcing

# Smallest share of the record that is searched, and growth factors of the horizon before and after
# that search.
FIRST_SHARE, FIRST_GROWTH, GROWTH = 0.2, 1.5, 2.0
# A start that leaves a smaller χ²/n over the first part lacks nothing that can be located there.
MIN_CHI2 = 1.3
# A source that leaves a larger χ²/n has lost the recording.
MAX_CHI2 = 1.5
# Tolerance of the fits; the last one is repeated with the exact simulator.
TOLERANCE = 0.01


def find_early_source(
    null: LeastSquaresProblem,
    phi: Tensor,
    samples: int,
    size: Tensor,
    candidate_count: int,
    report: Report,
) -> FoundSource | None:
    """Return a source that explains the whole recording within its noise, if there is one.

    Args:
        null: F of the start alone over the whole record.
        phi: its fit to the first samples, ``(mode,)``.
        samples: number of these samples.
        size: rms of each equation's own tendency, ``(equation,)``.
        candidate_count: number of terms in the library, for the penalty of the search.
        report: progress.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    total = len(null.recorded)
    begin = _first_misfit(null, phi, samples)
    if begin is None:
        return None
    horizon, phi = begin
    found: FoundSource | None = None
    while True:
        part = null.truncate(horizon)
        extended = None if found is None else refit_source(part, found, size, TOLERANCE)
        if extended is None or not _follows(part, extended):
            extended = _search(part, phi, size, candidate_count)
        if extended is None or not _follows(part, extended):
            return None
        found, phi, level = extended, extended.fit.phi, extended.fit.chi2 / part.noise.count
        report(horizon / total, f"a source over {horizon} of {total} samples, χ²/n {level:.2f}")
        if horizon == total:
            return found
        horizon = min(total, max(horizon + 1, round(GROWTH * horizon)))


def _first_misfit(
    null: LeastSquaresProblem, phi: Tensor, samples: int
) -> tuple[int, Tensor] | None:
    """Return the first horizon at which the start alone leaves more than noise, and its fit."""
    for fitted in growing_horizon_fits(null, phi, samples, FIRST_GROWTH):
        horizon = len(fitted.readings)
        level = fitted.chi2 / null.noise.truncate(horizon).count
        # Written with "not", because the misfit is NaN or infinite after a blow-up.
        if horizon >= FIRST_SHARE * len(null.recorded) and not level < MIN_CHI2:
            return horizon, fitted.phi
    return None


def _follows(part: LeastSquaresProblem, found: FoundSource) -> bool:
    # Written with "<", because the misfit is NaN or infinite after a blow-up.
    return found.fit.chi2 < MAX_CHI2 * part.noise.count


def _search(
    part: LeastSquaresProblem, phi: Tensor, size: Tensor, candidate_count: int
) -> FoundSource | None:
    """Return the best source over a part of the record, from a forcing on a coarse mesh."""
    [misfit], _ = part.values(phi[None])
    forcing, _ = fit_free_forcing(part, phi, size)
    coarse = LinearisedForcing(forcing.objective, forcing.block, forcing.normal).without_law()
    return best_source(part, coarse, forcing, float(misfit), size, candidate_count, TOLERANCE)
