"""Look for a cause at one place before any law is selected, and compare it with other causes.

Such causes are faulty sensors, a source, and a term in a window.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

from torch import Tensor

from dashred.core.budget import NEVER
from dashred.core.progress import Report, stage
from dashred.inference.fit.first_window import first_samples
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.comparison.comparison import Comparison
from dashred.inference.hypotheses.comparison.noise_reestimation import (
    noise_left_by,
    refit_under_noise,
)
from dashred.inference.hypotheses.first_part import first_parts
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, replace_minimum
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN, BestOfSize, Discovery
from dashred.inference.hypotheses.sensors.early_fault import find_early_fault
from dashred.inference.hypotheses.sources.early_source import find_early_source
from dashred.inference.hypotheses.sources.find_source import FoundSource, refit_source
from dashred.inference.hypotheses.sources.source_law import fit_source_law
from dashred.inference.hypotheses.terms_everywhere import best_terms_everywhere, follow_beyond
from dashred.inference.hypotheses.windows.early_window import find_early_window
from dashred.physics.runs.tendency_size import tendency_size
from dashred.pipeline.discovery.explained_record import is_record_explained
from dashred.pipeline.discovery.first_guess_stage import FittedGuess
from dashred.pipeline.discovery.prior_start import MAX_LAW_RATIO, fit_near_prior
from dashred.pipeline.discovery.stages.hypothesis_stage import compare_local_cause, with_windows
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.state_samples import state_samples

# Parts of the record that are searched, each longer than the one before.
MAX_PARTS = 3
# The fit without the cause needs little accuracy, because its misfit is large.
STEPS, TOLERANCE = 10, 0.005


def discover_local_cause(
    problem: Problem,
    nominal: NominalRun,
    objective: LeastSquaresProblem,
    simulator: Simulator,
    guesses: Sequence[FittedGuess],
    seconds: dict[str, float],
) -> Discovery | None:
    """Return the findings if a local cause explains the recording; None if not.

    Args:
        problem: recording and settings.
        nominal: simulation that gives the scales of the terms.
        objective: problem of all candidates over the whole record, with the start of the best
            guess.
        simulator: simulator at the resolution of the growing horizon.
        guesses: fitted first guesses, the best first.
        seconds: run time by stage, updated.
    """
    with stage("look for a local cause", seconds) as report:
        cause = problem.budget.attempt(
            "a local cause before any law",
            lambda: _find_local_cause(problem, nominal, objective, simulator, guesses[0], report),
            None,
        )
        report(1.0, "none" if cause is None else _name(cause))
    if cause is None:
        return None
    return _compare_with_others(problem, nominal, objective, cause, guesses, seconds)


def _find_local_cause(
    problem: Problem,
    nominal: NominalRun,
    objective: LeastSquaresProblem,
    simulator: Simulator,
    guess: FittedGuess,
    report: Report,
) -> HypothesisFit | None:
    """Return a source, or a term in a window, that explains the whole recording.

    Args:
        problem: recording and settings.
        nominal: simulation that gives the scales.
        objective: problem of all candidates over the whole record, with the start of the guess.
        simulator: simulator at the resolution of the growing horizon.
        guess: best first guess.
        report: progress.

    Returns:
        The law under the noise that it leaves; None if there is no such cause. For faulty sensors
        it is the uncorrected simulator, from the start that the other sensors determine.

    Raises:
        OutOfTimeError: there was no time for the search.
    """
    samples = state_samples(problem, nominal)
    size = tendency_size(samples.system, samples.states, samples.times)
    objective = replace(objective, deadline=problem.deadline("look for a local cause"))
    exact = objective.subset(())
    null = replace(exact, forward_model=replace(exact.forward_model, simulator=simulator))
    law = replace(objective, forward_model=replace(objective.forward_model, simulator=simulator))
    count = len(objective.prior_std)
    for part in islice(first_parts(null, guess.z, first_samples(null), size), MAX_PARTS):
        everywhere = best_terms_everywhere(objective, part)
        if not everywhere.explain:
            sound = find_early_fault(null, part, report)
            if sound is not None:
                return _with_all_sensors(sound, exact)
        source = find_early_source(null, part, size, everywhere, count, report)
        if source is not None:
            return _source_with_own_noise(replace(exact, deadline=NEVER), nominal, source, size)
        if everywhere.explain and follow_beyond(law, part, everywhere):
            return None
        # Windows take seconds to compile. A longer part may tell them from terms everywhere.
        if not everywhere.explain:
            local = with_windows(problem, nominal, objective)
            found = find_early_window(local, part, count, report)
            return None if found is None else _with_own_noise(found, nominal)
    return None


def _compare_with_others(
    problem: Problem,
    nominal: NominalRun,
    objective: LeastSquaresProblem,
    cause: HypothesisFit,
    guesses: Sequence[FittedGuess],
    seconds: dict[str, float],
) -> Discovery | None:
    """Compare a local cause with all other causes.

    Args:
        problem: recording and settings.
        nominal: simulation that gives the scales of the terms.
        objective: problem of all candidates over the whole record.
        cause: the law of the cause, under the noise that it leaves.
        guesses: fitted first guesses, the best first.
        seconds: run time by stage, updated.

    Returns:
        The findings; None if the cause alone does not explain the recording.
    """
    deadline = problem.deadline("compare hypotheses")
    objective = replace(objective, noise=cause.objective.noise, deadline=deadline)
    objective = objective.with_start(cause.objective.forward_model.start)
    cause = replace(cause, objective=replace(cause.objective, deadline=deadline))
    with stage("compare hypotheses", seconds) as report:
        null = replace(objective.subset(()), deadline=NEVER)
        # Faulty sensors would drag the start away from the one that the others determine.
        steps = 0 if deadline.is_over or not cause.law.parts else STEPS
        fitted = minimise(null, cause.phi[: null.modes], steps, TOLERANCE)
        null = replace(null, deadline=deadline)
        empty = HypothesisFit(build_law(null, fitted, fitted.cost), null, fitted.phi)
        comparison = problem.budget.attempt(
            "all other causes",
            lambda: compare_local_cause(problem, nominal, objective, cause, empty, report),
            _uncompared(cause, empty),
        )
        report(1.0, str(comparison.laws[0]))
    best = comparison.laws[0]
    # What is left, or what other causes explain beside it, may be a law that acts everywhere.
    is_mixed = best.faults and (best.candidates or best.source is not None)
    is_rest = comparison.forcing_gain > MIN_FORCING_GAIN or is_mixed
    if is_rest or not is_record_explained(problem, comparison):
        return None
    count = objective.noise.count
    nothing = BestOfSize((), (), empty.law.score, math.sqrt(fitted.cost / count))
    return Discovery(
        laws=comparison.laws,
        uncorrected=comparison.uncorrected,
        noise=comparison.noise,
        first_guesses={g.name: g.error for g in guesses},
        first_guess=guesses[0].name,
        levels=[(len(objective.recorded), best.chi2)],
        is_horizon_complete=True,
        free_chi2=best.chi2,
        is_search_complete=True,
        path=[nothing],
        refit_count=0,
        forcing_gain=comparison.forcing_gain,
        forcing_map=comparison.forcing_map,
        source=comparison.source,
    )


def _with_all_sensors(sound: HypothesisFit, null: LeastSquaresProblem) -> HypothesisFit:
    """Return a fit without some sensors as one of all, whose readings it does not follow.

    Args:
        sound: the fit of the start alone without these sensors.
        null: F of the start alone over the whole record, with all sensors.
    """
    problem = replace(null, noise=noise_left_by(sound).over(null.noise), deadline=NEVER)
    fitted = minimise(problem, sound.phi, 0, TOLERANCE)
    return HypothesisFit(build_law(problem, fitted, fitted.cost), problem, fitted.phi)


def _name(cause: HypothesisFit) -> str:
    return str(cause.law) if cause.law.parts else "faulty sensors"


def _uncompared(cause: HypothesisFit, empty: HypothesisFit) -> Comparison:
    noise, source = cause.objective.noise, cause.law.source
    return Comparison([cause.law, empty.law], empty.law, noise, noise, 0.0, None, source)


def _source_with_own_noise(
    null: LeastSquaresProblem, nominal: NominalRun, source: FoundSource, size: Tensor
) -> HypothesisFit:
    """Return the law of a source under the noise that it leaves, with the prior of the start.

    The prior is used if a fit with it follows the recording as well (:func:`fit_near_prior`).
    """
    exact = refit_source(null, source, size)
    if null.forward_model.start is not nominal.start:
        law = fit_source_law(null, exact, size)
        near = fit_near_prior(nominal.start, law.objective, law.phi, MAX_LAW_RATIO)
        if near is not None:
            null = null.with_start(nominal.start)
            start = near[1].phi[: null.modes]
            exact = refit_source(null, replace(exact, fit=replace(exact.fit, phi=start)), size)
    null = replace(null, noise=exact.fit.noise().over(null.noise))
    return fit_source_law(null, refit_source(null, exact, size), size)


def _with_own_noise(fit: HypothesisFit, nominal: NominalRun) -> HypothesisFit:
    """Return a law under the noise that it leaves, with the prior of the start if possible."""
    fit = replace(fit, objective=replace(fit.objective, deadline=NEVER))
    near = fit_near_prior(nominal.start, fit.objective, fit.phi, MAX_LAW_RATIO)
    if near is not None:
        fit = replace_minimum(fit, *near)
    return refit_under_noise(fit, noise_left_by(fit))
