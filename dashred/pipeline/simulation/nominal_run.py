"""The uncorrected simulation from its nominal start."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import torch
from torch import Tensor

from dashred.core.progress import stage
from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.runs.initial_state_prior import (
    StartPrior,
    field_rms,
    fitted_modes,
    nominal_start,
)
from dashred.physics.solvers.simulate import check_finite, simulate
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nudging import nudged_where_lost, smooth_runs
from dashred.pipeline.simulation.segmented_record import can_restart, restarted_where_lost
from dashred.pipeline.simulation.start_modes import start_prior
from dashred.pipeline.simulation.time_limit import within


@dataclass(frozen=True)
class NominalRun:
    """The uncorrected simulation at the times of the recording.

    Attributes:
        prior: prior of the start.
        states: simulation from the nominal start, ``(time, field, *grid)``.
        others: the same for the other fitted episodes, with their times and inputs.
        whole: the same for the episodes that are held out as a whole.
        restarted: the simulator restarted along the readings or corrected towards them, for each
            fitted episode; empty unless its simulation leaves the range of the recording, blows up
            or is not resolved.
    """

    prior: StartPrior
    states: Tensor
    others: tuple[Tensor, ...] = field(default=())
    whole: tuple[Tensor, ...] = field(default=())
    restarted: tuple[Tensor, ...] = field(default=())

    @property
    def references(self) -> tuple[Tensor, ...]:
        """States that give scales and ranges, ``(time, field, *grid)`` for each fitted episode."""
        return self.restarted or (self.states, *self.others)

    @cached_property
    def start(self) -> StartModel:
        """Prior of the starts of all fitted episodes."""
        return EpisodeStarts((self.prior,) * (1 + len(self.others)))


@torch.no_grad()
def simulate_nominal(problem: Problem, seconds: dict[str, float]) -> NominalRun:
    """Run the simulator from its nominal start, after the spin-up.

    A simulator may lack what keeps it bounded. Then it is restarted along the readings, or its
    fields are corrected towards them at every sample, for what scales need.

    Raises:
        InputError: the simulation blows up, and there are snapshots instead of equations.
        OutOfTimeError: there is no time for it.
    """
    system, times = problem.system, problem.times
    restarted: tuple[Tensor, ...] = ()
    with stage("spin up and simulate", seconds) as report:
        timed = within(problem.deadline("simulate"), report)
        start = nominal_start(system, lambda done: timed(0.8 * done))
        path = simulate(system, start, times, progress=lambda done: timed(0.8 + 0.2 * done))
        others, whole = (
            tuple(simulate(e.system, start, e.times)[0] for e in episodes)
            for episodes in (problem.others, problem.whole)
        )
        if can_restart(problem):
            restarted = restarted_where_lost(problem, start[0], path[0])
        elif problem.snapshots is None:
            prior = StartPrior(system, start[0], field_rms(start), fitted_modes(system))
            restarted = nudged_where_lost(problem, prior, (path[0], *others), timed)
        else:
            check_finite(path, times, system)
    prior = start_prior(problem, start[0], restarted[0] if restarted else path[0])
    return NominalRun(prior, path[0], others, whole, restarted)


def can_be_corrected(problem: Problem, nominal: NominalRun) -> bool:
    """Return whether a run of fields can be corrected towards the readings, and is not yet."""
    has_modes = bool(problem.system.axes) and nominal.prior.size > 0
    return has_modes and problem.snapshots is None and not nominal.restarted


@torch.no_grad()
def corrected_towards_readings(
    problem: Problem, nominal: NominalRun, seconds: dict[str, float]
) -> NominalRun:
    """Return the runs of a simulator of fields, corrected towards the readings at every sample.

    A simulator may lack what keeps its fields smooth. Its own run is then no measure of anything.

    Args:
        problem: the recording.
        nominal: runs of the simulator.
        seconds: run time by stage, updated.

    Raises:
        OutOfTimeError: there is no time for them.
    """
    with stage("correct a run towards the readings", seconds) as report:
        timed = within(problem.deadline("simulate"), report)
        states = smooth_runs(problem, nominal.prior, timed)
        start = nominal.prior.centre[None]
        return replace(nominal, prior=start_prior(problem, start[0], states[0]), restarted=states)
