"""Discovery: fit the start and a sparse law to the sensors through the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from dashred.core.progress import stage
from dashred.core.tracking import RunTracker
from dashred.inference.fit.forecast_choice import MOST_TERMS
from dashred.inference.fit.stepwise_selection import (
    select,
)
from dashred.inference.forward.candidates import Candidate, build_candidates, indices_by_name
from dashred.inference.forward.parameter_block import split_parameters
from dashred.inference.hypotheses.comparison.comparison import Comparison
from dashred.inference.hypotheses.result import Discovery
from dashred.inference.segments.findings.force_map import force_map
from dashred.inference.segments.selection.left_force import force_beside
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.sensor_faults.error_curve import follows_state
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline.assimilation import AssimilationResult
from dashred.pipeline.discovery.first_guess_stage import fit_first_guesses
from dashred.pipeline.discovery.headline_law import headline_law, with_headline
from dashred.pipeline.discovery.horizon_stage import (
    extend_horizon,
    fit_from_first_guesses,
    selection_prior,
    with_residual_noise,
)
from dashred.pipeline.discovery.hypothesis_stage import (
    compare_explanations,
    forcing_gain_on,
    is_record_explained,
    is_start_explained,
)
from dashred.pipeline.discovery.law_metrics import log_best_by_size, log_first_guesses
from dashred.pipeline.discovery.least_squares import (
    build_least_squares,
    coarse_simulator,
    exact_simulator,
)
from dashred.pipeline.discovery.local_cause_stage import discover_local_cause
from dashred.pipeline.discovery.prior_start import select_near_prior
from dashred.pipeline.discovery.segments.library_choice import is_explained
from dashred.pipeline.discovery.segments.segment_horizon import follow_segments
from dashred.pipeline.discovery.segments.segment_stage import discover_in_segments, with_few_terms
from dashred.pipeline.discovery.selected_laws import (
    MAX_RIVALS,
    best_by_size,
    fit_best,
    room_left_for,
)
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.state_samples import state_samples
from dashred.pipeline.training import TrainedNetwork


@torch.no_grad()
def discover(
    problem: Problem,
    nominal: NominalRun,
    resolution: Resolution,
    ensemble: Ensemble,
    network: TrainedNetwork,
    assimilated: AssimilationResult,
    segments: SegmentSearch | None,
    run: RunTracker,
    seconds: dict[str, float],
) -> Discovery:
    """Fit the first guesses, extend the horizon, select the terms and compare hypotheses.

    See docs/method.md#fit-through-the-simulator.

    Args:
        problem: recording and settings.
        nominal: simulation that gives the scales of the terms.
        resolution: numerical error of the simulation.
        ensemble: simulations from which first guesses are made.
        network: SHRED, with its errors on test members.
        assimilated: reconstructed fields and the terms that latent SINDy proposes.
        segments: laws found over segments, which are returned if no trajectory reaches the end of
            the record and no other cause explains it; None if there are none.
        run: tracker of the parent run.
        seconds: run time by stage, updated.
    """
    samples = state_samples(problem, nominal)
    parameters, candidates = split_parameters(
        build_candidates(
            samples.system,
            problem.library,
            samples.states,
            samples.times,
            problem.extensions,
            problem.parameter_priors,
            problem.let_terms,
        )
    )
    proposals = _proposals(problem, candidates, assimilated)
    with run.child("discover") as child:
        simulator = exact_simulator(problem, candidates, parameters=parameters)
        weak = problem.config.discovery.weak
        explained = segments is not None and is_explained(segments)
        followed = None
        if segments is not None and explained:
            with stage("fit one trajectory to the record", seconds):
                objective = build_least_squares(problem, simulator, nominal.start, candidates, weak)
                followed = follow_segments(objective, segments)
        if followed is not None:
            guesses, (guess, horizon) = [followed[0]], followed
        else:
            with stage("fit the first guesses", seconds) as report:
                coarse = coarse_simulator(problem, simulator, resolution)
                guesses = fit_first_guesses(
                    problem, coarse, nominal, ensemble, network, assimilated, report
                )
                errors = ", ".join(f"{g.name} {g.error:.2f}" for g in guesses)
                report(1.0, f"{errors} σ error at the sensors")
            if problem.system.axes:
                begin = guesses[0].start
                objective = build_least_squares(problem, simulator, begin, candidates, weak)
                local = discover_local_cause(problem, nominal, objective, coarse, guesses, seconds)
                if local is not None:
                    return local
            with stage("grow the horizon", seconds) as report:
                guess, horizon = fit_from_first_guesses(
                    problem, coarse, candidates, guesses, report
                )
            if segments is not None and explained and not horizon.is_complete:
                return discover_in_segments(problem, segments, child, seconds)
        log_first_guesses(run, child, guesses, guess, horizon)
        if horizon.widened:
            proposals = [horizon.widened, *proposals]
            weak = selection_prior(problem.config.discovery.tight, weak, horizon)
        objective = build_least_squares(problem, simulator, guess.start, candidates, weak)
        deadline = problem.deadline("select the law")
        objective = replace(with_residual_noise(objective, horizon), deadline=deadline)
        with stage("select the law", seconds) as report:
            selection = select(objective.truncate(horizon.samples), horizon.phi, proposals, report)
            if not horizon.is_complete:
                horizon, selection = extend_horizon(
                    objective, horizon, selection, proposals, report
                )
            selection = select_near_prior(nominal.start, selection, MAX_RIVALS, report)
            objective = objective.with_start(selection.objective.forward_model.start)
            report(1.0, f"{len(selection.tried)} sets refitted")
        if not selection.exhausted and deadline.is_over:
            problem.budget.leave_out("further sets of terms")
        with stage("fit the law to the end", seconds) as report:
            later = problem.deadline("fit the law to the end")
            selection = replace(selection, objective=replace(selection.objective, deadline=later))
            laws, ranked, nothing, uncorrected = fit_best(selection)
            report(1.0, str(laws[0]))
            told = problem.budget.attempt(
                "forecasts of smaller laws",
                lambda: headline_law(selection, laws[0].score),
                None,
            )
        # Many terms make up for a small model error, which the fit over segments allows for.
        has_model_error = (
            told is not None and segments is not None and is_explained(with_few_terms(segments))
        )
        with stage("compare hypotheses", seconds) as report:
            seen = selection.objective.noise.over(objective.noise)
            deadline = problem.deadline("compare hypotheses")
            compared = None
            if not has_model_error:
                compared = problem.budget.attempt(
                    "all other causes",
                    lambda: compare_explanations(
                        problem,
                        nominal,
                        replace(objective, noise=seen, deadline=deadline),
                        horizon.samples,
                        laws,
                        ranked,
                        nothing,
                        guesses[0],
                        report,
                    ),
                    None,
                )
            comparison = compared or Comparison(laws, uncorrected, seen, seen, 0.0, None)
            if is_start_explained(problem, comparison.laws[0]):
                # A forcing explains what the modes of the start leave in the first samples.
                comparison = replace(comparison, forcing_gain=0.0, forcing_map=None, source=None)
            report(1.0, str(comparison.laws[0]))
        is_complete = horizon.is_complete or (
            compared is not None and is_record_explained(problem, compared)
        )
        # A law of many terms imitates other causes; without the comparison it is no finding.
        is_compared = compared is not None and not compared.is_cut_short
        is_unchecked = told is None and not is_compared and len(laws[0].candidates) > MOST_TERMS
        # An error that is the same in every episode imitates a law that is missing.
        faults = comparison.laws[0].faults
        imitates = any(follows_state([c.value for c in fault.curves]) for fault in faults)
        is_complete = is_complete and not is_unchecked and not (imitates and segments is not None)
        if segments is not None and not is_complete:
            return discover_in_segments(problem, segments, child, seconds)
        path = best_by_size(selection, nothing)
        log_best_by_size(child, path)
    part = selection.objective
    # If the horizon did not reach the end, its misfit does not hold for the whole record.
    free_chi2, room = comparison.laws[0].chi2, None
    if horizon.is_complete:
        free_chi2 = float(part.residuals(horizon.readings).square().sum()) / part.noise.count
        fits = [nothing, *ranked]
        room = room_left_for(part, fits, comparison.laws[0], horizon.readings, free_chi2)
    found = Discovery(
        laws=comparison.laws,
        uncorrected=comparison.uncorrected,
        noise=comparison.noise,
        first_guesses={g.name: g.error for g in guesses},
        first_guess=guess.name,
        levels=horizon.levels,
        is_horizon_complete=is_complete,
        free_chi2=free_chi2,
        is_search_complete=selection.exhausted,
        path=path,
        refit_count=len(selection.tried),
        forcing_gain=comparison.forcing_gain,
        forcing_map=comparison.forcing_map,
        source=comparison.source,
        room_left=room,
    )
    if told is not None:
        gain = 0.0
        if not has_model_error:
            gain = max(told.further_gain, forcing_gain_on(told.fit, problem, nominal))
        found = with_headline(found, told.fit.law, gain)
    return found if segments is None else _with_left_force(found, segments)


def _with_left_force(found: Discovery, segments: SegmentSearch) -> Discovery:
    """Return the discovery with the force that its law leaves unexplained over segments."""
    best = found.best
    if best.window is not None or best.source is not None or best.faults or not best.candidates:
        return found
    left = force_beside(segments, best)
    if left is None:
        return found
    gain = max(found.forcing_gain, left.gain)
    return replace(found, forcing_gain=gain, forcing_map=force_map(left))


def _proposals(
    problem: Problem, candidates: Sequence[Candidate], assimilated: AssimilationResult
) -> list[tuple[int, ...]]:
    """Return the sets of candidates that Algorithms 1 and 2 propose, as indices."""
    index = indices_by_name(candidates)
    names = [f"{term.equation}: {term}" for term in problem.library]
    sets = []
    for fit in assimilated.proposals.values():
        named = zip(names, fit.coefficients, strict=True)
        # A term that an uncertain parameter replaces is no candidate.
        chosen = {index[name] for name, value in named if value and name in index}
        sets.append(tuple(sorted(chosen)))
    return [members for members in sets if members]
