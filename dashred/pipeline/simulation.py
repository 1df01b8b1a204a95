"""Simulate: the established start, the nominal run, the resolution check, the ensemble."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from dashred.core.progress import stage
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.runs.ensemble import Discrepancies, Ensemble, draw_ensemble
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.runs.resolution import Resolution, check_resolution, minimum_scale
from dashred.physics.solvers.simulate import check_finite, simulate
from dashred.physics.system import System
from dashred.pipeline.problem import Problem


@dataclass(frozen=True)
class Nominal:
    """The simulator as it is, over the recording's clock.

    Attributes:
        prior: what is known of the start.
        states: the simulation from the nominal start, ``(time, field, *grid)``.
        others: the same over the clocks, and under the inputs, of the other fitted episodes.
        whole: the same over those that are held out whole.
    """

    prior: StartPrior
    states: Tensor
    others: tuple[Tensor, ...] = field(default=())
    whole: tuple[Tensor, ...] = field(default=())

    @cached_property
    def start(self) -> StartModel:
        """What is known of the starts of all fitted episodes."""
        return EpisodeStarts((self.prior,) * (1 + len(self.others)))


@torch.no_grad()
def simulate_nominal(problem: Problem, seconds: dict[str, float]) -> Nominal:
    """Run the simulator from its own established start.

    Raises:
        InputError: it blows up.
    """
    system, times = problem.system, problem.times
    with stage("spin up and simulate", seconds) as report:
        start = nominal_start(system, lambda done: report(0.8 * done, ""))
        path = simulate(system, start, times, progress=lambda done: report(0.8 + 0.2 * done, ""))
        check_finite(path, times, system)
    modes = system.config.spread.get("modes")
    prior = StartPrior(system, start[0], field_rms(path[0]), None if modes is None else int(modes))
    further = [
        tuple(simulate(e.system, start, e.times)[0] for e in episodes)
        for episodes in (problem.others, problem.whole)
    ]
    return Nominal(prior, path[0], *further)


@torch.no_grad()
def check(problem: Problem, nominal: Nominal, seconds: dict[str, float]) -> Resolution:
    """Double the resolution and compare what the recording's sensors would read.

    Under every episode's inputs: the worst one tells. Without any inputs one run is like the other.
    """
    every = (*problem.split.fit.sensors, *problem.split.validation.sensors)
    sensors = tuple({sensor.name: sensor for sensor in every}.values())

    def readings(system: System, states: Tensor) -> Tensor:
        return ObservationOperator(sensors, system)(states)

    noise, limit = problem.noise_of(tuple(s.name for s in sensors)), problem.config.resolution_limit
    reads = [sensor.reads for sensor in sensors]

    def checked(episode: Problem, path: Tensor) -> Resolution:
        coarse = readings(episode.system, path[None])
        least = minimum_scale(coarse[0], noise, reads, limit)
        base = episode.system, path[:1], episode.times, coarse, readings, least, limit
        return check_resolution(*base, lambda done: report(done, ""))

    episodes = problem.episodes if problem.system.inputs else (problem,)
    paths = (nominal.states, *nominal.others)
    with stage("check the resolution", seconds) as report:
        found = [checked(*pair) for pair in zip(episodes, paths, strict=False)]
        worst = max(found, key=lambda resolution: resolution.error)
        report(1.0, f"doubling moves a trace by {worst.error:.2%} of its std")
    return worst


@torch.no_grad()
def simulate_ensemble(problem: Problem, nominal: Nominal, seconds: dict[str, float]) -> Ensemble:
    """Draw the members that SHRED learns from, over the fit window."""
    settings = problem.config.simulation
    count = len(problem.split.fit.times)
    discrepancies = None
    if settings.discrepancy:
        discrepancies = Discrepancies(problem.library, settings.terms, settings.amplitude)
    # Each under its own inputs; without any, the longest says most of how far a field may move.
    paths = (nominal.states, *nominal.others)
    if not problem.system.inputs:
        paths = (nominal.states,) * len(problem.episodes)
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
                lambda done: report(done, ""),
            )
            for (episode, times, members, suffix), path in zip(
                shares(problem, settings.members), paths, strict=False
            )
        ]
        ensemble = together(drawn)
        kind = "with random discrepancies" if settings.discrepancy else "plain"
        report(1.0, f"{settings.members} members, {kind}")
    return ensemble


def shares(problem: Problem, members: int) -> Iterator[tuple[Problem, Tensor, int, str]]:
    """Yield episodes with a clock as long as the longest, their members, and a name for dice.

    Of more episodes than members the last have none.
    """
    episodes = problem.episodes
    passed = problem.times[: len(problem.split.fit.times)] - problem.times[0]
    for index, episode in enumerate(episodes):
        share = len(range(index, members, len(episodes)))
        if not share:
            return
        if episode is problem:
            yield episode, problem.times[: len(passed)], share, ""
        else:
            yield episode, episode.times[0] + passed, share, f" {episode.name}"


def together(drawn: Sequence[Ensemble]) -> Ensemble:
    """Return the members of all episodes, on the clock of the first."""
    if len(drawn) == 1:
        return drawn[0]
    # By turns, so that members of every episode are among those that are held out.
    turns = [turn for ensemble in drawn for turn in range(len(ensemble.states))]
    order = sorted(range(len(turns)), key=turns.__getitem__)
    states = torch.cat([ensemble.states for ensemble in drawn])[order]
    coefficients = torch.cat([ensemble.coefficients for ensemble in drawn])[order]
    return Ensemble(drawn[0].times, states, coefficients)
