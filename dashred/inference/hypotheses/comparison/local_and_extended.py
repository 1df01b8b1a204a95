"""Laws that act in a window, and laws with a term beyond the library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from dashred.core.budget import Budget
from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.comparison.comparison import Additions
from dashred.inference.hypotheses.comparison.repeated_screening import repeat_screening
from dashred.inference.hypotheses.comparison.residual_forcing import (
    MAX_SIMPLE_TERMS,
    ResidualForcing,
    imitates_no_window,
)
from dashred.inference.hypotheses.extended.extended_library import fit_extended_laws
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import (
    REJECTION_MARGIN,
    HypothesisFit,
    by_score,
)
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN
from dashred.inference.hypotheses.windows.windowed_laws import fit_windowed_laws


def fit_local_and_extended(
    residual: ResidualForcing,
    additions: Additions,
    periodic_fits: Sequence[HypothesisFit],
    budget: Budget,
    report: Report,
) -> tuple[list[HypothesisFit], float]:
    """Return laws in windows and beyond the library, and the forcing gain on the best of them."""
    report(0.4, "screening terms by place, time and state")
    all_candidates = range(len(residual.full_problem.prior_std))
    null_score = residual.null.law.score
    windowed_problem = _with_simulator(residual.full_problem, additions.windowed_simulator())

    def screen(forcing: FreeForcing, bound: float) -> list[HypothesisFit]:
        local_fits = fit_windowed_laws(
            windowed_problem, additions.global_count, all_candidates, forcing, null_score, bound
        )
        return residual.add_faults(local_fits)

    def screen_in_time(forcing: FreeForcing, bound: float) -> list[HypothesisFit]:
        return budget.attempt("laws in a window", lambda: screen(forcing, bound), [])

    first_fit = min([residual.best, *periodic_fits], key=by_score)
    fits, best_fit, nearest, forcing_gain = repeat_screening(
        first_fit,
        screen_in_time,
        residual.forcings,
        residual.forcing_gain,
        additions.tendency_rms,
        report,
    )
    if forcing_gain > MIN_FORCING_GAIN or len(best_fit.law.candidates) >= MAX_SIMPLE_TERMS:
        report(0.8, "screening terms beyond the library")

        def fit_extended() -> tuple[list[HypothesisFit], float]:
            extended = residual.add_faults(_fit_extended(residual, additions, nearest, math.inf))
            return extended, _update_gain(extended, best_fit, forcing_gain, additions.tendency_rms)

        nothing: list[HypothesisFit] = []
        extended_fits, forcing_gain = budget.attempt(
            "laws beyond the library", fit_extended, (nothing, forcing_gain)
        )
        fits += extended_fits
    if residual.full_problem.deadline.is_over:
        budget.leave_out("further laws in a window or beyond the library")
    return fits, forcing_gain


def fit_single_terms(residual: ResidualForcing, additions: Additions) -> list[HypothesisFit]:
    """Return laws of one term, in a window or beyond the library, that may rival the best law.

    A law whose coefficients are all certain may imitate a function beyond the library by the first
    terms of its series. A term in a window would leave something.
    """
    best, forcing = residual.best, residual.best_forcing
    bound, null_score = best.law.score + REJECTION_MARGIN, residual.null.law.score
    extended = _fit_extended(residual, additions, forcing, bound)
    if imitates_no_window(best.law):
        return extended
    windowed_problem = _with_simulator(residual.full_problem, additions.windowed_simulator())
    indices = _candidates_in_same_equations(residual.full_problem, best)
    local_fits = fit_windowed_laws(windowed_problem, 0, indices, forcing, null_score, bound)
    return [*local_fits, *extended]


def _fit_extended(
    residual: ResidualForcing, additions: Additions, forcing: FreeForcing, bound: float
) -> list[HypothesisFit]:
    """Return laws with terms beyond the library, searched about the trajectory of a forcing."""
    candidates, library_size = additions.extended_candidates(), additions.global_count
    return fit_extended_laws(residual.full_problem, candidates, forcing, library_size, bound)


def _with_simulator(problem: LeastSquaresProblem, simulator: Simulator) -> LeastSquaresProblem:
    """Return F with another simulator."""
    return replace(problem, forward_model=replace(problem.forward_model, simulator=simulator))


def _candidates_in_same_equations(
    full_problem: LeastSquaresProblem, best: HypothesisFit
) -> list[int]:
    """Return the indices of the candidates in the equations of a law."""
    equations = {candidate.equation for candidate in best.law.candidates}
    candidates = full_problem.forward_model.law.candidates
    return [j for j, candidate in enumerate(candidates) if candidate.equation in equations]


def _update_gain(
    extended_fits: Sequence[HypothesisFit],
    best_fit: HypothesisFit,
    forcing_gain: float,
    tendency_rms: Tensor,
) -> float:
    """Return the forcing gain on the best extended law if this is the best law."""
    best_extended = min([best_fit, *extended_fits], key=by_score)
    if best_extended is best_fit:
        return forcing_gain
    return fit_free_forcing(best_extended.objective, best_extended.phi, tendency_rms)[1]
