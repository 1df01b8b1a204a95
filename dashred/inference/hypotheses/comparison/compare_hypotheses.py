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
from dashred.inference.fit.selection.stepwise_selection import term_penalty
from dashred.inference.hypotheses.comparison.backward_elimination import eliminate_terms
from dashred.inference.hypotheses.comparison.comparison import Additions, Comparison
from dashred.inference.hypotheses.comparison.faults_beside_laws import (
    forcing_gain_beside,
    forcing_gain_over,
    is_curves_alone,
    is_seen_by_one_sensor,
    refit_rivals_beside_faults,
    search_faults_beside_best,
)
from dashred.inference.hypotheses.comparison.fitted_hypotheses import FittedHypotheses
from dashred.inference.hypotheses.comparison.forced_and_local import add_forced_and_local
from dashred.inference.hypotheses.comparison.global_hypotheses import (
    fit_fault_hypotheses,
    fit_other_starts,
    is_of_other_shape,
    under_same_prior,
    without_penalty,
)
from dashred.inference.hypotheses.comparison.local_source import (
    SourceHypothesis,
    map_forcing,
)
from dashred.inference.hypotheses.comparison.needless_terms import drop_needless_terms
from dashred.inference.hypotheses.comparison.noise_reestimation import (
    refit_under_best_noise,
)
from dashred.inference.hypotheses.comparison.residual_forcing import (
    ResidualForcing,
    add_forcing_alone,
    fit_residual_forcing,
)
from dashred.inference.hypotheses.hypothesis_fit import (
    HypothesisFit,
    by_score,
)
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN
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
        best: the best law that acts everywhere, or a source that was found before any law.
        null: the uncorrected simulator.
        rivals: other laws that act everywhere and do about as well as the best.
        additions: what may be added.
        budget: gets the hypotheses that were left out.
        report: progress.

    Raises:
        OutOfTimeError: there was no time for any other hypothesis.
    """
    with_faults = fit_fault_hypotheses(best, null, budget)
    if best.law.source is not None and is_seen_by_one_sensor(best, with_faults):
        best, with_faults = null, [fit for fit in with_faults if fit.law.source is None]
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
    return Comparison(
        laws, null.law, noise, noise, 0.0, None, source=laws[0].source, is_cut_short=True
    )


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
    has_rivals = len(best.law.candidates) > 1 and any(
        not best.law.parts <= rival.law.parts for rival in rivals
    )
    residual = fit_residual_forcing(
        full_problem, best, null, has_rivals, additions.tendency_rms, report
    )
    hypotheses = FittedHypotheses(budget, list(with_faults))
    if residual.is_unclear:
        # Their noise is now that of the forcing.
        hypotheses.fits = fit_fault_hypotheses(residual.best, residual.null, budget)
    starts = fit_other_starts(residual.best, residual.null, budget)
    if starts and is_of_other_shape(starts[0], hypotheses.fits):
        # Causes are then compared under its prior, which is no cause.
        start = without_penalty(starts[0])
        wide = full_problem.with_start(start.objective.forward_model.start)
        again = compare_hypotheses(wide, start, start, [], additions, budget, report)
        return replace(again, laws=[under_same_prior(law, start.law) for law in again.laws])
    hypotheses.fits += starts
    source, forcing_gain = add_forced_and_local(hypotheses, residual, additions, report)
    forcing_gain = _add_sensor_faults(hypotheses, residual, rivals, additions, forcing_gain)
    is_missing = residual.is_unclear and residual.forcing_alone is None
    if is_missing and _needs_forcing_alone(hypotheses.leader.law, forcing_gain):
        residual = budget.attempt(
            "a forcing without a law",
            lambda: add_forcing_alone(residual, additions.tendency_rms),
            residual,
        )
    return _conclude(hypotheses, residual, source, forcing_gain, report)


def _add_sensor_faults(
    hypotheses: FittedHypotheses,
    residual: ResidualForcing,
    rivals: Sequence[HypothesisFit],
    additions: Additions,
    forcing_gain: float,
) -> float:
    """Add sensor faults beside the best law, and refit all under the noise that the best leaves.

    Args:
        hypotheses: fits so far, updated.
        residual: the best law that acts everywhere and the free forcings on top of it.
        rivals: other laws that act everywhere and do about as well as the best.
        additions: what may be added.
        forcing_gain: evidence for a free forcing on top of the best hypothesis.

    Returns:
        The evidence for a free forcing, without the faulty sensors.
    """
    hypotheses.add("laws without terms again", lambda: eliminate_terms(hypotheses.fits))
    hypotheses.add(
        "rivals beside a sensor fault",
        lambda: refit_rivals_beside_faults(residual, hypotheses.fits, rivals),
    )
    searched = {fit.law.parts for fit in (residual.best, residual.null)}
    found = hypotheses.add(
        "sensor faults beside the best law",
        lambda: search_faults_beside_best(hypotheses.fits, searched),
    )
    if found and forcing_gain > MIN_FORCING_GAIN:
        forcing_gain = forcing_gain_beside(min(found, key=by_score), additions.tendency_rms)
    if residual.is_unclear or hypotheses.leader.faults:
        hypotheses.replace_all("refits under the noise of the best law", refit_under_best_noise)
        hypotheses.add(
            "sensor faults under the noise of the best law",
            lambda: search_faults_beside_best(hypotheses.fits, set()),
        )
    # A fit without a term may have ended in another minimum than that of the best law.
    penalty = term_penalty(residual.full_problem)
    hypotheses.add(
        "the best law without a term",
        lambda: drop_needless_terms(hypotheses.leader, penalty),
    )
    return forcing_gain


def _needs_forcing_alone(best: Law, forcing_gain: float) -> bool:
    """Tell whether a forcing is mapped, or compared with sensors that wander without any law."""
    is_mapped = best.source is not None or forcing_gain > MIN_FORCING_GAIN
    return is_mapped or is_curves_alone(best)


def _conclude(
    hypotheses: FittedHypotheses,
    residual: ResidualForcing,
    source: SourceHypothesis,
    forcing_gain: float,
    report: Report,
) -> Comparison:
    """Return all hypotheses, ranked, with a map of the forcing if something is unexplained."""
    best, uncorrected = hypotheses.leader, hypotheses.uncorrected
    if residual.forcing_alone is not None and is_curves_alone(best.law):
        over_faults = forcing_gain_over(best, uncorrected, residual.forcing_alone)
        forcing_gain = max(forcing_gain, over_faults)
    laws = distinct_laws(
        [profile_threshold(fit) if fit is best else fit.law for fit in hypotheses.fits]
    )
    forcing_map, located = residual.forcing_map, laws[0].source
    if located is not None or forcing_gain > MIN_FORCING_GAIN:
        report(0.9, "mapping the forcing in space and time")
        forcing_map = map_forcing(residual, forcing_gain, located)
        located = located or source.located
    noise, forced_noise = uncorrected.objective.noise, residual.full_problem.noise
    return Comparison(
        laws, uncorrected.law, noise, forced_noise, forcing_gain, forcing_map, located
    )
