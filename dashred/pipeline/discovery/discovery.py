"""Discovery: fit the start and a sparse law to the sensors through the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from callbacks.law_selection import NAME as DYNAMICS
from dashred.core.progress import stage
from dashred.core.tracking import RunTracker
from dashred.inference.fit.forecast_choice import MOST_TERMS
from dashred.inference.forward.candidates import Candidate, build_candidates, indices_by_name
from dashred.inference.forward.parameter_block import split_parameters
from dashred.inference.hypotheses.comparison.comparison import Comparison
from dashred.inference.hypotheses.result import BestOfSize, Discovery
from dashred.inference.segments.findings.force_map import force_map
from dashred.inference.segments.selection.left_force import force_beside
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.sensor_faults.error_curve import follows_state
from dashred.pipeline.discovery.explained_record import is_record_explained, is_start_explained
from dashred.pipeline.discovery.headline_law import with_headline
from dashred.pipeline.discovery.inputs import DiscoveryInputs
from dashred.pipeline.discovery.law_metrics import log_best_by_size, log_first_guesses
from dashred.pipeline.discovery.least_squares import exact_simulator
from dashred.pipeline.discovery.segments.library_choice import is_explained
from dashred.pipeline.discovery.segments.segment_stage import discover_in_segments, with_few_terms
from dashred.pipeline.discovery.selected_laws import best_by_size, room_left_for
from dashred.pipeline.discovery.stages.first_trajectory import FirstTrajectory, fit_first_trajectory
from dashred.pipeline.discovery.stages.hypothesis_stage import compare_explanations, forcing_gain_on
from dashred.pipeline.discovery.stages.law_stage import SelectedLaws, select_laws
from dashred.pipeline.networks.assimilation import AssimilationResult
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.state_samples import state_samples


@torch.no_grad()
def discover(given: DiscoveryInputs, run: RunTracker, seconds: dict[str, float]) -> Discovery:
    """Fit the first guesses, extend the horizon, select the terms and compare hypotheses.

    See docs/method.md#fit-through-the-simulator.

    Args:
        given: recording, simulations, and results of the stages before.
        run: tracker of the parent run.
        seconds: run time by stage, updated.
    """
    problem, nominal, segments = given.problem, given.nominal, given.segments
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
            samples.moved,
        )
    )
    simulator = exact_simulator(problem, candidates, parameters=parameters)
    with run.child("discover") as child:
        first = fit_first_trajectory(given, simulator, candidates, child, seconds)
        if isinstance(first, Discovery):
            return first
        log_first_guesses(run, child, first.guesses, first.guess, first.horizon)
        proposals = _proposals(problem, candidates, given.assimilated)
        selected = select_laws(given, simulator, candidates, first, proposals, seconds)
        has_model_error = _has_model_error(given, selected)
        compared = None if has_model_error else _compare(given, selected, first, seconds)
        is_complete = _is_complete(given, selected, compared)
        if segments is not None and not is_complete:
            return discover_in_segments(problem, segments, child, seconds)
        path = best_by_size(selected.selection, selected.nothing)
        log_best_by_size(child, path)
    comparison = compared or _uncompared(selected)
    if is_start_explained(problem, comparison.laws[0]):
        # A forcing explains what the modes of the start leave in the first samples.
        comparison = replace(comparison, forcing_gain=0.0, forcing_map=None, source=None)
    found = _findings(selected, comparison, first, path, is_complete=is_complete)
    if selected.told is not None:
        told, gain = selected.told, 0.0
        if not has_model_error:
            gain = max(told.further_gain, forcing_gain_on(told.fit, problem, nominal))
        found = with_headline(found, told.fit.law, gain)
    return found if segments is None else _with_left_force(found, segments)


def _has_model_error(given: DiscoveryInputs, selected: SelectedLaws) -> bool:
    """Tell whether many terms make up for a small model error.

    The fit over segments allows for such an error.
    """
    segments = given.segments
    if selected.told is None or segments is None:
        return False
    return is_explained(with_few_terms(segments))


def _compare(
    given: DiscoveryInputs,
    selected: SelectedLaws,
    first: FirstTrajectory,
    seconds: dict[str, float],
) -> Comparison | None:
    """Compare the selected laws with all other causes; None if there is no time for it."""
    problem, objective = given.problem, selected.objective
    deadline = problem.deadline("compare hypotheses")
    with stage("compare hypotheses", seconds) as report:
        compared = problem.budget.attempt(
            "all other causes",
            lambda: compare_explanations(
                problem,
                given.nominal,
                replace(objective, noise=selected.noise, deadline=deadline),
                selected.horizon.samples,
                selected.laws,
                selected.ranked,
                selected.nothing,
                first.guesses[0],
                report,
            ),
            None,
        )
        report(1.0, str(selected.laws[0] if compared is None else compared.laws[0]))
    return compared


def _uncompared(selected: SelectedLaws) -> Comparison:
    """Return the selected laws alone."""
    noise = selected.noise
    return Comparison(selected.laws, selected.uncorrected, noise, noise, 0.0, None)


def _is_complete(
    given: DiscoveryInputs, selected: SelectedLaws, compared: Comparison | None
) -> bool:
    """Tell whether the best law, or another cause, explains the whole record."""
    is_reached = selected.horizon.is_complete or (
        compared is not None and is_record_explained(given.problem, compared)
    )
    # A law of many terms imitates other causes; without the comparison it is no finding.
    is_compared = compared is not None and not compared.is_cut_short
    has_many_terms = len(selected.laws[0].candidates) > MOST_TERMS
    is_unchecked = selected.told is None and not is_compared and has_many_terms
    # An error that is the same in every episode imitates a law that is missing.
    faults = () if compared is None else compared.laws[0].faults
    imitates = any(follows_state([c.value for c in fault.curves]) for fault in faults)
    return is_reached and not is_unchecked and not (imitates and given.segments is not None)


def _findings(
    selected: SelectedLaws,
    comparison: Comparison,
    first: FirstTrajectory,
    path: list[BestOfSize],
    *,
    is_complete: bool,
) -> Discovery:
    """Return the findings, with what the fit of the best law could still gain."""
    part, horizon = selected.selection.objective, selected.horizon
    # If the horizon did not reach the end, its misfit does not hold for the whole record.
    free_chi2, room = comparison.laws[0].chi2, None
    if horizon.is_complete:
        free_chi2 = float(part.residuals(horizon.readings).square().sum()) / part.noise.count
        fits = [selected.nothing, *selected.ranked]
        room = room_left_for(part, fits, comparison.laws[0], horizon.readings, free_chi2)
    return Discovery(
        laws=comparison.laws,
        uncorrected=comparison.uncorrected,
        noise=comparison.noise,
        first_guesses={g.name: g.error for g in first.guesses},
        first_guess=first.guess.name,
        levels=horizon.levels,
        is_horizon_complete=is_complete,
        free_chi2=free_chi2,
        is_search_complete=selected.selection.exhausted,
        path=path,
        refit_count=len(selected.selection.tried),
        forcing_gain=comparison.forcing_gain,
        forcing_map=comparison.forcing_map,
        source=comparison.source,
        room_left=room,
    )


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
    changed = [f"parameter {name}" for name in assimilated.parameters]
    sets = []
    for algorithm, fit in assimilated.proposals.items():
        named = [name for name, value in zip(names, fit.coefficients, strict=True) if value]
        named += changed if algorithm == DYNAMICS else []
        # A term that an uncertain parameter replaces is no candidate.
        sets.append(tuple(sorted({index[name] for name in named if name in index})))
    return [members for members in sets if members]
