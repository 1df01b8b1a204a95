"""Runs of a simulator that is given by equations or a program, and the laws over segments."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

from dashred.core.budget import OutOfTimeError, duration
from dashred.core.errors import InputError
from dashred.inference.segments.findings.segment_laws import law_from_segments, states_by_sample
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.physics.external.failure import hint_of_failure
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.discovery.segments.segment_stage import search_in_segments
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensembles import (
    ensemble_of_states,
    simulate_corrected_ensemble,
    simulate_ensemble,
    simulate_nudged_ensemble,
)
from dashred.pipeline.simulation.longer_step import with_longer_step
from dashred.pipeline.simulation.nominal_run import (
    NominalRun,
    can_be_corrected,
    corrected_towards_readings,
    simulate_nominal,
)
from dashred.pipeline.simulation.program_cost import follows_segments
from dashred.pipeline.simulation.resolution_check import check_discretisation
from dashred.pipeline.simulation.state_samples import state_samples
from dashred.pipeline.verification.structure import check_structure


@dataclass(frozen=True)
class SimulationRuns:
    """A problem and the runs of its simulator.

    Attributes:
        problem: problem, with the identifiable terms of the library.
        nominal: run from the nominal start.
        resolution: numerical error of that run.
        ensemble: randomised runs for training; None if the simulator is not resolved.
        segments: laws of a system without axes, found over segments; None for other systems.
    """

    problem: Problem
    nominal: NominalRun
    resolution: Resolution
    ensemble: Ensemble | None
    segments: SegmentSearch | None = None


def simulate(problem: Problem, seconds: dict[str, float]) -> SimulationRuns:
    """Run the simulator from its nominal start, at doubled resolution, and as an ensemble.

    Raises:
        InputError: the simulation blows up, the library has indistinguishable terms, or there is
            no time for the simulations.
    """
    try:
        return _simulate(problem, seconds)
    except OutOfTimeError:
        raise InputError(
            f"the simulations take longer than their part of the budget of "
            f"{problem.budget.seconds:g} s: {duration(problem.budget.spent, problem.budget.cpu)} "
            "since the start",
            where=problem.config.where("budget"),
            hint=hint_of_failure(
                problem.system.program,
                "increase budget=SECONDS, or choose a coarser grid or fewer simulation.members; "
                "other processes on the machine also take time",
            ),
        ) from None


def _simulate(problem: Problem, seconds: dict[str, float]) -> SimulationRuns:
    nominal = simulate_nominal(problem, seconds)
    problem = keep_identifiable_terms(problem, state_samples(problem, nominal))
    check_structure(problem.system, problem.times, nominal.references[0])
    resolution = check_discretisation(problem, nominal, seconds)
    if resolution.enough == 2 and not problem.system.axes:
        # A grid is the user's, and costs more. A shorter step of an ODE system costs little.
        dt = problem.system.dt / 2
        reason = f"time step: {dt:.6g}, half of the stated one, whose error is visible"
        problem = problem.with_step(dt, reason)
        nominal = simulate_nominal(problem, seconds)
        resolution = check_discretisation(problem, nominal, seconds)
    if resolution.enough is None and can_be_corrected(problem, nominal):
        nominal, resolution = _along_readings(problem, nominal, resolution, seconds)
    if not resolution.resolved:
        return SimulationRuns(problem, nominal, resolution, None)
    problem = with_longer_step(problem, nominal)
    problem, segments = search_in_segments(problem, nominal, seconds)
    if problem.hidden is not None:
        nominal = simulate_nominal(problem, seconds)
    ensemble = _training_ensemble(problem, nominal, segments, seconds)
    return SimulationRuns(problem, nominal, resolution, ensemble, segments)


def _along_readings(
    problem: Problem, nominal: NominalRun, resolution: Resolution, seconds: dict[str, float]
) -> tuple[NominalRun, Resolution]:
    """Return smooth states along the readings, if these are resolved and there is time for them.

    Args:
        problem: the recording.
        nominal: run of the simulator, which is not resolved.
        resolution: numerical error of that run.
        seconds: run time by stage, updated.

    Returns:
        These states and their numerical error, or the run and the error as they are.
    """

    def correct() -> tuple[NominalRun, Resolution]:
        along = corrected_towards_readings(problem, nominal, seconds)
        found = check_discretisation(problem, along, seconds)
        return (along, found) if found.resolved else (nominal, resolution)

    what = "smooth states along the readings"
    return problem.budget.attempt(what, correct, (nominal, resolution))


def _training_ensemble(
    problem: Problem,
    nominal: NominalRun,
    segments: SegmentSearch | None,
    seconds: dict[str, float],
) -> Ensemble:
    """Return the runs on which SHRED is trained.

    If there are too few of the simulator, in time and within bounds, the corrected simulator is
    run instead where its law is known already; without time for that, the states of the law serve.
    """
    try:
        return simulate_ensemble(problem, nominal, seconds)
    except (InputError, OutOfTimeError) as error:
        if segments is not None:
            if isinstance(error, OutOfTimeError):
                problem.budget.leave_out("training SHRED on the simulator without the law")
            law = law_from_segments(segments, segments.best)
            states = states_by_sample(segments, segments.best)
            with suppress(OutOfTimeError):
                if not follows_segments(problem):
                    return simulate_corrected_ensemble(problem, law, states, seconds)
            problem.budget.leave_out("training SHRED on any simulation")
            return ensemble_of_states(problem, states)
        if nominal.restarted and isinstance(error, InputError):
            return simulate_nudged_ensemble(problem, nominal, seconds)
        raise
