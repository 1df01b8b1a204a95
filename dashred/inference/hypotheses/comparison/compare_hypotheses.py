"""Compare the law with other hypotheses: a sensor fault, the initial state, a law in a window.

Every hypothesis is fitted with its own initial state. All are ranked by the same score
(docs/method.md#comparison-of-hypotheses).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.law import Law, distinct_laws
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.comparison.backward_elimination import eliminate_terms
from dashred.inference.hypotheses.comparison.faults_beside_laws import (
    forcing_gain_beside,
    forcing_gain_over,
    is_curves_alone,
    search_faults_beside_best,
)
from dashred.inference.hypotheses.comparison.noise_reestimation import (
    refit_under_best_noise,
    refit_under_noise,
)
from dashred.inference.hypotheses.comparison.repeated_screening import repeat_screening
from dashred.inference.hypotheses.comparison.residual_forcing import (
    MAX_SIMPLE_TERMS,
    ResidualForcing,
    fit_residual_forcing,
)
from dashred.inference.hypotheses.extended.extended_library import fit_extended_laws
from dashred.inference.hypotheses.extended.periodic_forcing import fit_periodic_laws
from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import (
    REJECTION_MARGIN,
    HypothesisFit,
    by_score,
    refit,
)
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN, MIN_FORCING_GAIN
from dashred.inference.hypotheses.sensors.fault_fits import fit_sensor_hypotheses
from dashred.inference.hypotheses.sensors.start_hypotheses import fit_start_hypotheses
from dashred.inference.hypotheses.windows.threshold_likelihood import profile_threshold
from dashred.inference.hypotheses.windows.windowed_laws import fit_windowed_laws

# Below this χ²/n, under the noise that a free forcing leaves, a fit needs no further terms.
MAX_EXPLAINED_CHI2 = 1.1


@dataclass(frozen=True)
class Additions:
    """What may be added to the simulator.

    Attributes:
        global_count: number of candidates that may act everywhere; these come first.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.
        windowed_simulator: builds the simulator with windows, which takes seconds to compile.
        extended_candidates: builds the terms beyond the library.
    """

    global_count: int
    tendency_rms: Tensor
    windowed_simulator: Callable[[], Simulator]
    extended_candidates: Callable[[], Sequence[Candidate]]


@dataclass(frozen=True)
class Comparison:
    """All hypotheses, scored under the same noise.

    Attributes:
        laws: the laws, the best first.
        uncorrected: the uncorrected simulator with its own best initial state.
        noise: the noise under which they were scored.
        forcing_gain: evidence for a free forcing on top of the best law.
        forcing_map: the map of a forcing on top of the uncorrected simulator; None if the best law
            is clear, if nothing is missing, or if no forcing can be fitted.
    """

    laws: list[Law]
    uncorrected: Law
    noise: NoiseModel
    forcing_gain: float
    forcing_map: ForcingMap | None


def compare_hypotheses(
    full_problem: LeastSquaresProblem,
    best: HypothesisFit,
    null: HypothesisFit,
    rivals: Sequence[HypothesisFit],
    additions: Additions,
    report: Report,
) -> Comparison:
    """Compare the best law that acts everywhere with other hypotheses.

    Args:
        full_problem: F of all candidates over the whole record.
        best: the best law that acts everywhere.
        null: the uncorrected simulator.
        rivals: other laws that act everywhere and do about as well as the best.
        additions: what may be added.
        report: progress.
    """
    has_rivals = len(best.law.candidates) > 1 and bool(rivals)
    residual = fit_residual_forcing(
        full_problem, best, null, has_rivals, additions.tendency_rms, report
    )
    fits, forcing_gain = _fit_global_hypotheses(residual.best, residual.null), residual.forcing_gain
    base_fits = residual.base_fits()
    if residual.faulty:
        fits += residual.add_faults(base_fits)
    periodic_fits = _fit_periodic(residual, base_fits, additions)
    fits += periodic_fits
    leader = min(fits, key=by_score)
    is_simple = len(leader.law.candidates) <= MAX_SIMPLE_TERMS
    if leader is not fits[0] and is_simple and leader.law.chi2 < MAX_EXPLAINED_CHI2:
        forcing_gain = 0.0
    elif residual.is_unclear:
        more_fits, forcing_gain = _fit_local_and_extended(
            residual, additions, periodic_fits, report
        )
        fits += more_fits
    elif len(residual.best.law.candidates) >= MAX_SIMPLE_TERMS:
        report(0.4, "fitting single terms in a window or beyond the library")
        fits += _fit_single_terms(residual, additions)
    fits += eliminate_terms(fits)
    fits += _refit_rivals_beside_fault(residual, fits, rivals)
    searched = {fit.law.parts for fit in (residual.best, residual.null)}
    found = search_faults_beside_best(fits, searched)
    fits += found
    if found and forcing_gain > MIN_FORCING_GAIN:
        best_with_faults = min(found, key=by_score)
        forcing_gain = forcing_gain_beside(best_with_faults, additions.tendency_rms)
    if residual.is_unclear or min(fits, key=by_score).faults:
        fits = refit_under_best_noise(fits)
        fits += search_faults_beside_best(fits, set())
    uncorrected = min((fit for fit in fits if not fit.law.parts), key=by_score)
    best_fit = min(fits, key=by_score)
    if residual.forcing_alone is not None and is_curves_alone(best_fit.law):
        over_faults = forcing_gain_over(best_fit, uncorrected, residual.forcing_alone)
        forcing_gain = max(forcing_gain, over_faults)
    laws = distinct_laws([profile_threshold(fit) if fit is best_fit else fit.law for fit in fits])
    noise = uncorrected.objective.noise
    return Comparison(laws, uncorrected.law, noise, forcing_gain, residual.forcing_map)


def _fit_periodic(
    residual: ResidualForcing, base_fits: Sequence[HypothesisFit], additions: Additions
) -> list[HypothesisFit]:
    """Return laws with a forcing that is periodic in time."""
    bound = min(base.law.score for base in base_fits) + REJECTION_MARGIN
    periodic_fits = [
        fit
        for base in base_fits
        for fit in fit_periodic_laws(base, additions.tendency_rms, additions.global_count, bound)
    ]
    return residual.add_faults(periodic_fits)


def _fit_local_and_extended(
    residual: ResidualForcing,
    additions: Additions,
    periodic_fits: Sequence[HypothesisFit],
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

    first_fit = min([residual.best, *periodic_fits], key=by_score)
    fits, best_fit, nearest, forcing_gain = repeat_screening(
        first_fit, screen, residual.forcings, additions.tendency_rms, report
    )
    if forcing_gain > MIN_FORCING_GAIN or len(best_fit.law.candidates) >= MAX_SIMPLE_TERMS:
        report(0.8, "screening terms beyond the library")
        extended_fits = residual.add_faults(_fit_extended(residual, additions, nearest, math.inf))
        forcing_gain = _update_gain(extended_fits, best_fit, forcing_gain, additions.tendency_rms)
        fits += extended_fits
    return fits, forcing_gain


def _fit_single_terms(residual: ResidualForcing, additions: Additions) -> list[HypothesisFit]:
    """Return laws of one term, in a window or beyond the library, that may rival the best law."""
    best, forcing = residual.best, residual.best_forcing
    windowed_problem = _with_simulator(residual.full_problem, additions.windowed_simulator())
    bound, null_score = best.law.score + REJECTION_MARGIN, residual.null.law.score
    indices = _candidates_in_same_equations(residual.full_problem, best)
    local_fits = fit_windowed_laws(windowed_problem, 0, indices, forcing, null_score, bound)
    return [*local_fits, *_fit_extended(residual, additions, forcing, bound)]


def _fit_extended(
    residual: ResidualForcing, additions: Additions, forcing: FreeForcing, bound: float
) -> list[HypothesisFit]:
    """Return laws with terms beyond the library, searched about the trajectory of a forcing."""
    candidates, library_size = additions.extended_candidates(), additions.global_count
    return fit_extended_laws(residual.full_problem, candidates, forcing, library_size, bound)


def _fit_global_hypotheses(best: HypothesisFit, null: HypothesisFit) -> list[HypothesisFit]:
    """Return the hypotheses that add no term: the laws, sensor faults and initial states."""
    fits = [best, null] if best.law.candidates else [null]
    fits += fit_sensor_hypotheses(null, best.law.score + AMBIGUITY_MARGIN)
    if best.law.candidates:
        fits += search_faults_beside_best([best], set())
    return fits + fit_start_hypotheses(null, best.law.score + REJECTION_MARGIN)


def _refit_rivals_beside_fault(
    residual: ResidualForcing, fits: Sequence[HypothesisFit], rivals: Sequence[HypothesisFit]
) -> list[HypothesisFit]:
    """Return the rivals of the best law with and without a sensor fault, if it won with one.

    Without the fault their scores could not be compared with that of the best law.
    """
    best_fit, noise = min(fits, key=by_score), residual.full_problem.noise
    if not best_fit.law.faults or best_fit.law.keys != residual.best.law.keys:
        return []
    if residual.faulty:
        refits = [refit(rival, replace(rival.objective, noise=noise)) for rival in rivals]
        return residual.add_faults(refits)
    bound = best_fit.law.score + AMBIGUITY_MARGIN
    refits = [refit_under_noise(rival, noise) for rival in rivals]
    with_faults = [fit for rival in refits for fit in fit_sensor_hypotheses(rival, bound)]
    return [*refits, *with_faults]


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
    best_extended = min(extended_fits, key=by_score)
    if best_extended.law.score >= best_fit.law.score:
        return forcing_gain
    return fit_free_forcing(best_extended.objective, best_extended.phi, tendency_rms)[1]
