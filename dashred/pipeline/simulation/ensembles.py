"""The ensembles of simulations on which SHRED is trained."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from dashred.core.progress import stage
from dashred.inference.fit.law import Law
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.runs.ensemble import Discrepancies, Ensemble, MemberSource
from dashred.physics.runs.stored_states import JoinedReader, StoredStates
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensemble_memory import (
    bytes_on_disk,
    check_in_memory,
    drawing,
    memory_of,
)
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.nudging import nudged_ensemble
from dashred.pipeline.simulation.program_cost import check_time
from dashred.pipeline.simulation.time_limit import within


@torch.no_grad()
def simulate_ensemble(problem: Problem, nominal: NominalRun, seconds: dict[str, float]) -> Ensemble:
    """Draw the simulations on which SHRED is trained, over the fit window.

    Raises:
        InputError: too few stay within bounds, or the disk has too little space for them.
        OutOfTimeError: there is no time for them.
    """
    settings = problem.config.simulation
    check_time(problem, settings.members, "simulate the ensemble")
    count = len(problem.split.fit.times)
    if memory_of(problem).is_on_disk:
        problem.scratch.check_space(bytes_on_disk(problem.config, problem.system, count))
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
            drawing(problem, f"ensemble {i}")(
                MemberSource(
                    episode.ensemble_system,
                    times,
                    nominal.prior,
                    path[:count],
                    discrepancies,
                    problem.rng(f"ensemble{suffix}"),
                    within(problem.deadline("simulate the ensemble"), report),
                ),
                members,
            )
            for i, ((episode, times, members, suffix), path) in enumerate(
                zip(split_members(problem, settings.members), paths, strict=False)
            )
        ]
        ensemble = join_ensembles(drawn)
        kind = "with random discrepancies" if settings.discrepancy else "plain"
        if not isinstance(ensemble.states, Tensor):
            kind += ", on disk"
        found = len(ensemble.states)
        lost = "" if found == settings.members else f" of {settings.members}; the others diverge"
        report(1.0, f"{found} members, {kind}{lost}")
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

    Raises:
        OutOfTimeError: the time for SHRED is over.
    """
    check_in_memory(problem)
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
            timed = within(problem.deadline("train SHRED"), report)
            runs = simulate(system, starts, times, progress=timed)
            lost = ~(torch.isfinite(runs) & (runs > low - width) & (runs < high + width)).all(
                2
            ).all(1)
            own = states[index]
            runs[lost] = own[torch.arange(len(times)) % len(own)]
            drawn.append(Ensemble(times, runs, torch.zeros((members, len(problem.library)))))
        report(1.0, "members of the corrected simulator")
    return join_ensembles(drawn)


def ensemble_of_states(problem: Problem, states: Sequence[Tensor]) -> Ensemble:
    """Return an ensemble without any simulation, for a program that takes too long.

    Args:
        problem: the recording.
        states: fitted states of each episode, ``(time, field)``: all its members.
    """
    check_in_memory(problem)
    elapsed = problem.times[: len(problem.split.fit.times)]
    drawn = []
    for index, (_, times, members, _) in enumerate(
        split_members(problem, problem.config.simulation.members)
    ):
        own = states[index][torch.arange(len(elapsed)) % len(states[index])]
        runs = own.expand(members, *own.shape).clone()
        drawn.append(Ensemble(times, runs, torch.zeros((members, len(problem.library)))))
    return join_ensembles(drawn)


@torch.no_grad()
def simulate_nudged_ensemble(
    problem: Problem, nominal: NominalRun, seconds: dict[str, float]
) -> Ensemble:
    """Draw the simulations on which SHRED is trained where none stays within bounds.

    They are corrected towards the readings at every sample.
    """
    check_in_memory(problem)
    rng = problem.rng("ensemble")
    with stage("simulate the ensemble", seconds) as report:
        drawn = [
            nudged_ensemble(episode, nominal.prior, members, times, rng)
            for episode, times, members, _ in split_members(
                problem, problem.config.simulation.members
            )
        ]
        report(1.0, "members corrected towards the readings")
    return join_ensembles(drawn)


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
    coefficients = torch.cat([ensemble.coefficients for ensemble in drawn])[order]
    in_memory = [e.states for e in drawn if isinstance(e.states, Tensor)]
    on_disk = [e.states for e in drawn if isinstance(e.states, StoredStates)]
    # All of them are kept in the same place.
    states = StoredStates(JoinedReader(on_disk), order) if on_disk else torch.cat(in_memory)[order]
    return Ensemble(drawn[0].times, states, coefficients)
