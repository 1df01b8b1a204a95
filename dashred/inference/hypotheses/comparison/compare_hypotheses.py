"""Compare the law with other hypotheses: a sensor fault, the initial state, a law in a window.

Every hypothesis is fitted with its own initial state. All are ranked by the same score
(docs/method.md#comparison-of-hypotheses).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.core.budget import Budget
from dashred.core.progress import Report
from dashred.inference.fit.law import Law, distinct_laws
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.comparison.backward_elimination import eliminate_terms
from dashred.inference.hypotheses.comparison.comparison import Additions, Comparison
from dashred.inference.hypotheses.comparison.faults_beside_laws import (
    forcing_gain_beside,
    forcing_gain_over,
    has_neighbouring_faults,
    is_curves_alone,
    refit_rivals_beside_faults,
    search_faults_beside_best,
)
from dashred.inference.hypotheses.comparison.global_hypotheses import (
    fit_fault_hypotheses,
    fit_other_starts,
    is_of_other_shape,
    under_same_prior,
    without_penalty,
)
from dashred.inference.hypotheses.comparison.local_and_extended import (
    fit_local_and_extended,
    fit_single_terms,
)
from dashred.inference.hypotheses.comparison.local_source import (
    SourceHypothesis,
    fit_local_source,
    map_forcing,
)
from dashred.inference.hypotheses.comparison.noise_reestimation import (
    refit_under_best_noise,
)
from dashred.inference.hypotheses.comparison.residual_forcing import (
    MAX_SIMPLE_TERMS,
    ResidualForcing,
    fit_residual_forcing,
)
from dashred.inference.hypotheses.extended.periodic_forcing import fit_periodic_laws
from dashred.inference.hypotheses.free_forcing import fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import (
    REJECTION_MARGIN,
    HypothesisFit,
    by_score,
)
from dashred.inference.hypotheses.result import MAX_EXPLAINED_CHI2, MIN_FORCING_GAIN
from dashred.inference.hypotheses.windows.threshold_likelihood import profile_threshold


def compare_hypotheses(
    full_problem: LeastSquaresProblem,
    best: HypothesisFit,
    null: HypothesisFit,
    rivals: Sequence[HypothesisFit],
    additions: Additions,
    budget: Budget,
    report: Report,
) -> Comparison:
    """Compare the best law that acts everywhere with other hypotheses.

    Sensor faults are common and quickly fitted, so they come first. If the deadline of F does not
    leave time for the rest, the law is compared with them alone. Single hypotheses for which there
    is no time are left out.

    Args:
        full_problem: F of all candidates over the whole record.
        best: the best law that acts everywhere.
        null: the uncorrected simulator.
        rivals: other laws that act everywhere and do about as well as the best.
        additions: what may be added.
        budget: gets the hypotheses that were left out.
        report: progress.

    Raises:
        OutOfTimeError: there was no time for any other hypothesis.
    """
    with_faults = fit_fault_hypotheses(best, null, budget)
    compared = budget.attempt(
        "causes other than sensor faults",
        lambda: _compare_all(
            full_problem, best, null, rivals, additions, with_faults, budget, report
        ),
        None,
    )
    if compared is not None:
        return compared
    noise = null.objective.noise
    laws = distinct_laws([*(fit.law for fit in with_faults), *(fit.law for fit in rivals)])
    return Comparison(laws, null.law, noise, noise, 0.0, None, is_cut_short=True)


def _compare_all(
    full_problem: LeastSquaresProblem,
    best: HypothesisFit,
    null: HypothesisFit,
    rivals: Sequence[HypothesisFit],
    additions: Additions,
    with_faults: Sequence[HypothesisFit],
    budget: Budget,
    report: Report,
) -> Comparison:
    """Compare the best law with all other hypotheses.

    Args:
        full_problem: F of all candidates over the whole record.
        best: the best law that acts everywhere.
        null: the uncorrected simulator.
        rivals: other laws that act everywhere and do about as well as the best.
        additions: what may be added.
        with_faults: the laws, without and with sensor faults.
        budget: gets the hypotheses that were left out.
        report: progress.

    Raises:
        OutOfTimeError: there was no time to compare them under one noise.
    """
    has_rivals = len(best.law.candidates) > 1 and bool(rivals)
    residual = fit_residual_forcing(
        full_problem, best, null, has_rivals, additions.tendency_rms, report
    )
    forcing_gain = residual.forcing_gain
    fits = list(with_faults)
    if residual.is_unclear:
        # Their noise is now that of the forcing.
        fits = fit_fault_hypotheses(residual.best, residual.null, budget)
    starts = fit_other_starts(residual.best, residual.null, budget)
    if starts and is_of_other_shape(starts[0], fits):
        # Causes are then compared under its prior, which is no cause.
        start = without_penalty(starts[0])
        wide = full_problem.with_start(start.objective.forward_model.start)
        again = compare_hypotheses(wide, start, start, [], additions, budget, report)
        return replace(again, laws=[under_same_prior(law, start.law) for law in again.laws])
    fits += starts
    base_fits = residual.base_fits()
    if residual.faulty:
        fits += budget.attempt(
            "the law with sensor faults", lambda: residual.add_faults(base_fits), []
        )
    nothing: list[HypothesisFit] = []
    periodic_fits = budget.attempt(
        "periodic forcings", lambda: _fit_periodic(residual, base_fits, additions), nothing
    )
    fits += periodic_fits
    source = SourceHypothesis()
    if residual.is_unclear:
        source = budget.attempt(
            "a localised source",
            lambda: fit_local_source(
                residual,
                base_fits[-1],
                min(fits, key=by_score),
                additions.tendency_rms,
                additions.global_count,
                report,
            ),
            source,
        )
        fits += source.fits
    leader = min(fits, key=by_score)
    # A simple fit that explains the recording, under the noise that a free forcing leaves, needs no
    # other terms. A source is compared with laws in a window: it may be a term in a region.
    is_simple = len(leader.law.candidates) <= MAX_SIMPLE_TERMS and leader.law.source is None
    # Neighbouring sensors that err may see a law that acts in a region.
    is_simple = is_simple and not has_neighbouring_faults(leader)
    if leader is not fits[0] and is_simple and leader.law.chi2 < MAX_EXPLAINED_CHI2:
        forcing_gain = 0.0
    elif source.is_clear:
        forcing_gain = fit_free_forcing(leader.objective, leader.phi, additions.tendency_rms)[1]
    elif residual.is_unclear:
        more_fits, forcing_gain = fit_local_and_extended(
            residual, additions, periodic_fits, budget, report
        )
        fits += more_fits
    elif _may_be_local(residual.best.law):
        report(0.4, "fitting single terms in a window or beyond the library")
        fits += budget.attempt(
            "single terms in a window or beyond the library",
            lambda: fit_single_terms(residual, additions),
            [],
        )
    fits += budget.attempt("laws without terms again", lambda: eliminate_terms(fits), [])
    fits += budget.attempt(
        "rivals beside a sensor fault",
        lambda: refit_rivals_beside_faults(residual, fits, rivals),
        [],
    )
    searched = {fit.law.parts for fit in (residual.best, residual.null)}
    found = budget.attempt(
        "sensor faults beside the best law",
        lambda: search_faults_beside_best(fits, searched),
        nothing,
    )
    fits += found
    if found and forcing_gain > MIN_FORCING_GAIN:
        best_with_faults = min(found, key=by_score)
        forcing_gain = forcing_gain_beside(best_with_faults, additions.tendency_rms)
    if residual.is_unclear or min(fits, key=by_score).faults:
        fits = budget.attempt(
            "refits under the noise of the best law", lambda: refit_under_best_noise(fits), fits
        )
        fits += budget.attempt(
            "sensor faults under the noise of the best law",
            lambda: search_faults_beside_best(fits, set()),
            [],
        )
    uncorrected = min((fit for fit in fits if not fit.law.parts), key=by_score)
    best_fit = min(fits, key=by_score)
    if residual.forcing_alone is not None and is_curves_alone(best_fit.law):
        over_faults = forcing_gain_over(best_fit, uncorrected, residual.forcing_alone)
        forcing_gain = max(forcing_gain, over_faults)
    laws = distinct_laws([profile_threshold(fit) if fit is best_fit else fit.law for fit in fits])
    noise = uncorrected.objective.noise
    forcing_map, located = residual.forcing_map, laws[0].source
    if located is not None or forcing_gain > MIN_FORCING_GAIN:
        report(0.9, "mapping the forcing in space and time")
        forcing_map = map_forcing(residual, forcing_gain, located)
        located = located or source.located
    forced_noise = residual.full_problem.noise
    return Comparison(
        laws, uncorrected.law, noise, forced_noise, forcing_gain, forcing_map, located
    )


def _may_be_local(law: Law) -> bool:
    """Tell whether a single term in a window, or one beyond the library, may rival a law."""
    is_local = law.source is not None or law.window is not None
    return is_local or len(law.candidates) >= MAX_SIMPLE_TERMS


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
