"""Simulations of the corrected simulator, over the fit window of every episode."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.core.progress import stage
from dashred.inference.fit.law import Law
from dashred.inference.initial_state.start_models import ScaledStart
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.runs.ensemble import Ensemble, MemberSource, ModelErrors
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensemble_memory import Draw, drawing
from dashred.pipeline.simulation.ensembles import split_members
from dashred.pipeline.simulation.program_cost import check_time
from dashred.pipeline.simulation.time_limit import within
from dashred.pipeline.trajectories import Trajectories

# Factors of the spread of the members that are tried in turn; the last is used in any case.
SPREAD_FACTORS, LAST_FACTOR = (1.0, 0.3), 0.1
# Returns the prior of the starts in an episode, of its corrected simulator and its index.
PriorOf = Callable[[System, int], StartPrior]


@dataclass(frozen=True)
class EpisodeEnsemble:
    """Simulations of one episode.

    Attributes:
        episode: the episode.
        system: its corrected simulator.
        ensemble: the simulations.
    """

    episode: Problem
    system: System
    ensemble: Ensemble


@torch.no_grad()
def simulate_corrected(
    problem: Problem,
    law: Law,
    free: Trajectories,
    prior_of: PriorOf,
    spread: float,
    members: int,
    name: str,
    seconds: dict[str, float],
    errors: ModelErrors | None = None,
) -> list[EpisodeEnsemble] | None:
    """Return simulations of every episode; None if they do not stay within bounds.

    Args:
        problem: simulator and recording.
        law: correction of the simulator.
        free: free runs; the corrected one limits the range of the members.
        prior_of: prior of the starts.
        spread: factor on the spread of the prior.
        members: number of simulations, of all episodes.
        name: of the stage.
        seconds: run time by stage, updated.
        errors: of the corrected simulator, for each member.

    Raises:
        OutOfTimeError: there was no time for them.
    """
    corrected = [free, *free.others]
    deadline = problem.deadline(name)
    check_time(problem, members, name)
    with stage(name, seconds) as report:
        progress = within(deadline, report)
        drawn = []
        for i, (episode, times, count, suffix) in enumerate(split_members(problem, members)):
            system = _ensemble_system(episode, law, law.start[i], times, free.shortest_dt)
            path = corrected[i].states["corrected"][: len(episode.split.fit.times)]
            rng = problem.rng(f"{name}{suffix}")
            draw = drawing(problem, f"{name} {i}")
            try:
                source = MemberSource(
                    system, times, prior_of(system, i), path, errors, rng, progress
                )
                drawn.append(
                    EpisodeEnsemble(episode, system, _members(draw, source, spread, count))
                )
            except InputError:
                report(1.0, "no member stays within bounds")
                return None
        report(1.0, f"{members} members")
    return drawn


def _ensemble_system(
    episode: Problem, law: Law, start: Tensor, times: Tensor, dt: float | None
) -> System:
    """Return the corrected simulator, with the time step of the ensemble if that is stable.

    Args:
        episode: its recording and simulator.
        law: the correction.
        start: the fitted start, ``(field, *grid)``.
        times: output times.
        dt: the time step that the corrected simulator needs; None if that of the simulator is
            stable.
    """
    if dt is not None:
        return build_corrected_system(episode.system, law).with_step(dt)
    quick = build_corrected_system(episode.ensemble_system, law)
    stable = bool(torch.isfinite(simulate(quick, start[None], times)).all())
    return quick if stable else build_corrected_system(episode.system, law)


def _members(draw: Draw, source: MemberSource, spread: float, members: int) -> Ensemble:
    """Draw members around a start.

    If too few of them stay within the range of the corrected run, the spread is reduced.

    Args:
        draw: simulates them.
        source: with the prior of the start.
        spread: factor on the spread of the prior.
        members: number of trajectories.
    """

    def scaled(factor: float) -> Ensemble:
        starts = ScaledStart(source.prior, factor * spread)
        return draw(replace(source, prior=starts), members)

    for factor in SPREAD_FACTORS:
        with suppress(InputError):
            return scaled(factor)
    return scaled(LAST_FACTOR)
