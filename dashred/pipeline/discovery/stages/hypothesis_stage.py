"""Compare the selected laws with other hypotheses: sensor faults, another start, local laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.core.budget import NEVER
from dashred.core.progress import Report
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise, minimise_growing_horizon
from dashred.inference.fit.selection.stepwise_selection import RefittedSet
from dashred.inference.forward.candidates import Candidate, replaced_terms
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.hypotheses.comparison.compare_hypotheses import compare_hypotheses
from dashred.inference.hypotheses.comparison.comparison import Additions, Comparison
from dashred.inference.hypotheses.comparison.faults_alone import compare_faults_alone
from dashred.inference.hypotheses.extended.extended_library import build_extended_candidates
from dashred.inference.hypotheses.free_forcing import fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN
from dashred.physics.runs.tendency_size import tendency_size
from dashred.physics.window import window_shapes
from dashred.pipeline.discovery.explained_record import is_noise_inflated
from dashred.pipeline.discovery.first_guess_stage import FittedGuess
from dashred.pipeline.discovery.least_squares import exact_simulator, fit_noise
from dashred.pipeline.discovery.prior_start import fit_near_prior
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.state_samples import state_samples

STEPS, TOLERANCE = 10, 1e-4
# If the misfit is more than this many times the noise, the fit without a law needs little accuracy.
LARGE_MISFIT, ROUGH_TOLERANCE = 5.0, 0.03
# Number of samples of the first fit without a law if no earlier fit is trusted.
FIRST_SAMPLES = 6


def compare_explanations(
    problem: Problem,
    nominal: NominalRun,
    objective: LeastSquaresProblem,
    samples: int,
    laws: Sequence[Law],
    ranked: Sequence[RefittedSet],
    nothing: RefittedSet,
    guess: FittedGuess,
    report: Report,
) -> Comparison:
    """Fit and compare all hypotheses over the whole record.

    Args:
        problem: recording and settings.
        nominal: simulation that gives the scales of the terms.
        objective: problem of all candidates over the whole record, with the noise estimated so far.
        samples: number of samples to which the laws were fitted.
        laws: laws that act everywhere, the best first.
        ranked: fits of these laws.
        nothing: fit of the empty law.
        guess: best first guess; it replaces the fitted start if the horizon did not reach the end
            of the record.
        report: progress.

    Raises:
        OutOfTimeError: there was no time for any other hypothesis.
    """
    best = ranked[0]
    reached = samples == len(objective.recorded)
    if is_noise_inflated(problem, objective.noise, is_whole=reached):
        # A sensor fault can cause this. Laws that were fitted with such noise are not meaningful.
        reached, objective = False, replace(objective, noise=fit_noise(problem))
    everything, additions = _with_additions(problem, nominal, objective)
    if samples < len(objective.recorded):
        everything = everything.with_start(guess.start)
        null, phi = everything.subset(()), guess.z
    else:
        null, phi = objective.subset(()), nothing.phi[: objective.modes]
    if not reached:
        phi = minimise_growing_horizon(null, phi, min(samples, FIRST_SAMPLES))
    far = reached and nothing.cost > LARGE_MISFIT * objective.noise.count
    fitted = minimise(null, phi, STEPS, ROUGH_TOLERANCE if far else TOLERANCE)
    if not (reached and best.members):
        again = fit_near_prior(nominal.start, null, fitted.phi)
        if again is not None:
            everything, (null, fitted) = everything.with_start(nominal.start), again
    empty = HypothesisFit(build_law(null, fitted, fitted.cost), null, fitted.phi)
    fits = [
        HypothesisFit(law, objective.subset(fit.members), fit.phi[objective.indices(fit.members)])
        for law, fit in zip(laws, ranked, strict=True)
    ]
    best_fit = fits[0] if reached else empty
    rivals = [fit for fit in fits[1:] if fit.law.score < laws[0].score + AMBIGUITY_MARGIN]
    comparison = compare_hypotheses(
        everything,
        best_fit,
        empty,
        rivals if reached else [],
        additions,
        problem.budget,
        report,
    )
    if not reached or null.forward_model.start is not objective.forward_model.start:
        return comparison
    found = comparison.laws[0]
    if found.parts != laws[0].parts or found.start_prior_factor > 1:
        return comparison
    return _with_global_laws(comparison, laws, objective)


def compare_local_cause(
    problem: Problem,
    nominal: NominalRun,
    objective: LeastSquaresProblem,
    cause: HypothesisFit,
    empty: HypothesisFit,
    report: Report,
) -> Comparison:
    """Compare a local cause, in the place of the best law, with all other hypotheses.

    If the cause has no terms, sensors are faulty; where they alone explain the recording, nothing
    else is fitted.

    Args:
        problem: recording and settings.
        nominal: simulation that gives the scales of the terms.
        objective: problem of all candidates over the whole record.
        cause: the law of the cause.
        empty: the uncorrected simulator.
        report: progress.

    Raises:
        OutOfTimeError: there was no time for any other hypothesis.
    """
    everything, additions = _with_additions(problem, nominal, objective)
    if not cause.law.parts:
        alone = compare_faults_alone(empty, additions.tendency_rms, problem.budget)
        if alone is not None:
            return alone
    return compare_hypotheses(everything, cause, empty, [], additions, problem.budget, report)


def with_windows(
    problem: Problem, nominal: NominalRun, objective: LeastSquaresProblem
) -> LeastSquaresProblem:
    """Return the problem with the terms that may act locally, and windows for all terms."""
    everything, additions = _with_additions(problem, nominal, objective)
    simulator = additions.windowed_simulator()
    return replace(everything, forward_model=replace(everything.forward_model, simulator=simulator))


def _with_additions(
    problem: Problem, nominal: NominalRun, objective: LeastSquaresProblem
) -> tuple[LeastSquaresProblem, Additions]:
    """Return the problem with the terms that may act locally, and what may be added to it."""
    samples = state_samples(problem, nominal)
    system, states, times = samples.system, samples.states, samples.times
    known = list(objective.forward_model.law.candidates)
    parameters = objective.forward_model.simulator.parameters
    changed = [*parameters.candidates, *known]
    local = replaced_terms(system, problem.library, changed, states, times)
    everything = _with_candidates(objective, local, problem.config.discovery.weak)
    additions = Additions(
        global_count=len(known),
        tendency_rms=tendency_size(system, states, times),
        windowed_simulator=lambda: exact_simulator(
            problem, [*known, *local], window_shapes(problem.system), parameters
        ),
        extended_candidates=lambda: build_extended_candidates(
            system, problem.library, states, times
        ),
    )
    return everything, additions


def _with_global_laws(
    comparison: Comparison, laws: Sequence[Law], objective: LeastSquaresProblem
) -> Comparison:
    """Return the comparison with the laws of the selection, if its best law is the best of all.

    These laws keep their fits. The scores of the other hypotheses are shifted by the difference
    between the two scores of the best law.
    """
    shift = laws[0].score - comparison.laws[0].score
    known = {law.parts for law in laws}
    others = [
        replace(law, score=law.score + shift) for law in comparison.laws if law.parts not in known
    ]
    ranked = sorted([*laws, *others], key=lambda law: law.score)
    return replace(comparison, laws=ranked, noise=objective.noise)


def forcing_gain_on(fit: HypothesisFit, problem: Problem, nominal: NominalRun) -> float:
    """Return the evidence for a free forcing on top of a law."""
    samples = state_samples(problem, nominal)
    size = tendency_size(samples.system, samples.states, samples.times)
    objective = replace(fit.objective, deadline=NEVER)
    return fit_free_forcing(objective, fit.phi, size)[1]


def _with_candidates(
    objective: LeastSquaresProblem, local: Sequence[Candidate], weak: float
) -> LeastSquaresProblem:
    """Return the least-squares problem with additional candidates."""
    forward_model = objective.forward_model
    law = LawBlock([*forward_model.law.candidates, *local])
    return objective.with_unknowns(
        replace(forward_model, law=law), weak * law.scales[len(objective.prior_std) :]
    )
