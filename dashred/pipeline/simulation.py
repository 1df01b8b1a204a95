"""Simulation stages: nominal run, resolution check and ensemble."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from dashred.core.budget import Deadline
from dashred.core.progress import Report, stage
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.fit.law import Law
from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.initial_state.start_models import StartModel
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.runs.ensemble import Discrepancies, Ensemble, draw_ensemble
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.runs.resolution import (
    Resolution,
    accumulated_error,
    check_resolution,
    minimum_scale,
)
from dashred.physics.solvers.simulate import Progress, check_finite, simulate
from dashred.physics.system import System
from dashred.pipeline.problem import Problem
from dashred.pipeline.segments import can_restart, local_resolution, restarted_where_lost

# First part of a record in which a simulation without its dissipation may still be resolved.
EARLY_SHARE = 0.25


@dataclass(frozen=True)
class NominalRun:
    """The uncorrected simulation at the times of the recording.

    Attributes:
        prior: prior of the start.
        states: simulation from the nominal start, ``(time, field, *grid)``.
        others: the same for the other fitted episodes, with their times and inputs.
        whole: the same for the episodes that are held out as a whole.
        restarted: the simulator restarted along the readings, for each fitted episode; empty
            unless its simulation leaves the range of the recording or blows up.
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

    A simulator without axes may lack what keeps it bounded: then it is restarted along the
    readings for what scales need.

    Raises:
        InputError: the simulation blows up, and cannot be restarted.
    """
    system, times = problem.system, problem.times
    restarted: tuple[Tensor, ...] = ()
    with stage("spin up and simulate", seconds) as report:
        timed = within(problem.deadline("simulate"), report)
        start = nominal_start(system, lambda done: timed(0.8 * done))
        path = simulate(system, start, times, progress=lambda done: timed(0.8 + 0.2 * done))
        if can_restart(problem):
            restarted = restarted_where_lost(problem, start[0], path[0])
        else:
            check_finite(path, times, system)
    modes = system.config.spread.get("modes")
    rms = field_rms(restarted[0] if restarted else path[0])
    prior = StartPrior(system, start[0], rms, None if modes is None else int(modes))
    others, whole = (
        tuple(simulate(e.system, start, e.times)[0] for e in episodes)
        for episodes in (problem.others, problem.whole)
    )
    return NominalRun(prior, path[0], others, whole, restarted)


@torch.no_grad()
def check_discretisation(
    problem: Problem, nominal: NominalRun, seconds: dict[str, float]
) -> Resolution:
    """Double the resolution and return the largest change of the sensor readings.

    If the record is chaotic, the errors of short segments are added up instead
    (:func:`.resolution.accumulated_error`). If only those of the first part are small, and no finer
    grid is sufficient, the search may find the dissipation that the simulation lacks. The
    resolution of the corrected simulation is checked then (:func:`check_corrected`).

    If the system has inputs, every episode is checked and the worst result is returned. Without
    inputs all episodes have the same simulation, so one is checked.
    """
    every = (*problem.split.fit.sensors, *problem.split.validation.sensors)
    sensors = tuple({sensor.name: sensor for sensor in every}.values())

    def readings(system: System, states: Tensor) -> Tensor:
        return ObservationOperator(sensors, system)(states)

    noise, limit = problem.noise_of(tuple(s.name for s in sensors)), problem.config.resolution_limit
    if can_restart(problem):
        with stage("check the resolution", seconds) as report:
            local = local_resolution(problem, sensors, nominal.references, noise, limit)
            report(1.0, f"doubling changes a trace by {local.error:.2%} of its std in a segment")
        return local
    reads = [sensor.reads for sensor in sensors]

    def checked(episode: Problem, path: Tensor) -> Resolution:
        coarse = readings(episode.system, path[None])
        least = minimum_scale(coarse[0], noise, reads, limit)
        found = check_resolution(
            episode.system,
            path[:1],
            episode.times,
            coarse,
            readings,
            least,
            limit,
            within(problem.deadline("simulate"), report),
        )
        if found.resolved:
            return found
        # If a finer grid is sufficient, it is better to use it.
        shares = (1.0,) if found.enough else (1.0, EARLY_SHARE)
        for share in shares:
            summed = accumulated_error(episode.system, path, episode.times, readings, least, share)
            if summed <= limit:
                return Resolution(summed, limit, 1, is_early=share < 1)
        return found

    episodes = problem.episodes if problem.system.inputs else (problem,)
    paths = (nominal.states, *nominal.others)
    with stage("check the resolution", seconds) as report:
        resolutions = [checked(*pair) for pair in zip(episodes, paths, strict=False)]
        worst = max(resolutions, key=lambda resolution: resolution.error)
        report(1.0, f"doubling changes a trace by {worst.error:.2%} of its std")
    return worst


@torch.no_grad()
def check_corrected(problem: Problem, law: Law, states: Tensor) -> Resolution:
    """Return the resolution of the corrected simulation of the longest episode.

    Args:
        problem: the recording.
        law: the law.
        states: the corrected simulation in the fit window, ``(time, field, *grid)``.
    """
    system, sensors = build_corrected_system(problem.system, law), problem.split.fit.sensors
    limit, noise = problem.config.resolution_limit, problem.noise_of(problem.split.fit.names)

    def readings(own: System, path: Tensor) -> Tensor:
        return ObservationOperator(sensors, own)(path)

    traces = readings(system, states[None])[0]
    least = minimum_scale(traces, noise, [sensor.reads for sensor in sensors], limit)
    times = problem.times[: len(states)]
    return Resolution(accumulated_error(system, states, times, readings, least), limit, None)


@torch.no_grad()
def simulate_ensemble(problem: Problem, nominal: NominalRun, seconds: dict[str, float]) -> Ensemble:
    """Draw the simulations on which SHRED is trained, over the fit window."""
    settings = problem.config.simulation
    count = len(problem.split.fit.times)
    discrepancies = None
    if settings.discrepancy:
        discrepancies = Discrepancies(problem.library, settings.terms, settings.amplitude)
    # The nominal run limits the range of the fields. Each episode has its own if there are inputs.
    # Without inputs the run of the longest episode covers the range best.
    paths = nominal.references
    if not problem.system.inputs:
        paths = (paths[0],) * len(problem.episodes)
    with stage("simulate the ensemble", seconds) as report:
        drawn = [
            draw_ensemble(
                episode.ensemble_system,
                times,
                nominal.prior,
                path[:count],
                members,
                discrepancies,
                problem.rng(f"ensemble{suffix}"),
                within(problem.deadline("simulate the ensemble"), report),
            )
            for (episode, times, members, suffix), path in zip(
                split_members(problem, settings.members), paths, strict=False
            )
        ]
        ensemble = join_ensembles(drawn)
        kind = "with random discrepancies" if settings.discrepancy else "plain"
        report(1.0, f"{settings.members} members, {kind}")
    return ensemble


@torch.no_grad()
def simulate_corrected_ensemble(
    problem: Problem, law: Law, states: Sequence[Tensor], seconds: dict[str, float]
) -> Ensemble:
    """Draw the simulations on which SHRED is trained from a corrected simulator.

    For a simulator that does not stay within bounds over the record: the corrected one starts from
    states that were fitted along the readings. Members that blow up are replaced by those states.

    Args:
        problem: the recording.
        law: the correction.
        states: fitted states of each episode, ``(time, field)``.
        seconds: run time by stage, updated.
    """
    rng = problem.rng("ensemble")
    pool = torch.cat(list(states))
    low, high = pool.amin(dim=0), pool.amax(dim=0)
    width = high - low
    drawn = []
    with stage("simulate the ensemble", seconds) as report:
        shares = split_members(problem, problem.config.simulation.members)
        for index, (episode, times, members, _) in enumerate(shares):
            system = build_corrected_system(episode.ensemble_system, law)
            starts = pool[torch.from_numpy(rng.integers(len(pool), size=members))]
            runs = simulate(system, starts, times)
            lost = ~(torch.isfinite(runs) & (runs > low - width) & (runs < high + width)).all(
                2
            ).all(1)
            own = states[index]
            runs[lost] = own[torch.arange(len(times)) % len(own)]
            drawn.append(Ensemble(times, runs, torch.zeros((members, len(problem.library)))))
        report(1.0, "members of the corrected simulator")
    return join_ensembles(drawn)


def within(deadline: Deadline, report: Report) -> Progress:
    """Return a callback of a simulation that shows its progress and ends it at a deadline."""

    def progress(done: float) -> None:
        # A simulation that is done is used.
        if done < 1:
            deadline.check()
        report(done, "")

    return progress


def split_members(problem: Problem, members: int) -> Iterator[tuple[Problem, Tensor, int, str]]:
    """Split the members of an ensemble over the fitted episodes.

    If there are more episodes than members, the last episodes have no member.

    Yields:
        The episode; its times, over the length of the fit window of the longest episode; its
        number of members; and the suffix of the name of its random number generator.
    """
    episodes = problem.episodes
    elapsed = problem.times[: len(problem.split.fit.times)] - problem.times[0]
    for index, episode in enumerate(episodes):
        count = len(range(index, members, len(episodes)))
        if not count:
            return
        if episode is problem:
            yield episode, problem.times[: len(elapsed)], count, ""
        else:
            yield episode, episode.times[0] + elapsed, count, f" {episode.name}"


def join_ensembles(drawn: Sequence[Ensemble]) -> Ensemble:
    """Return the members of all episodes as one ensemble, with the times of the first."""
    if len(drawn) == 1:
        return drawn[0]
    # The episodes alternate, so that the held-out members come from every episode.
    positions = [i for ensemble in drawn for i in range(len(ensemble.states))]
    order = sorted(range(len(positions)), key=positions.__getitem__)
    states = torch.cat([ensemble.states for ensemble in drawn])[order]
    coefficients = torch.cat([ensemble.coefficients for ensemble in drawn])[order]
    return Ensemble(drawn[0].times, states, coefficients)
