"""The memory that an ensemble takes, and where it is kept.

An ensemble that would take too much is written to disk, and all that reads it reads it in parts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.core.stated.memory import machine_memory, memory_text, parse_memory
from dashred.models.stored_pod import GROUP_BYTES
from dashred.physics.runs.ensemble import Ensemble, MemberSource, draw_ensemble
from dashred.physics.runs.initial_state_prior import fitted_modes
from dashred.physics.runs.members_on_disk import WORK_BYTES, draw_ensemble_to_disk
from dashred.physics.system import System
from dashred.pipeline.problem import Problem

KEY = "simulation.memory"
# Share of the machine's memory that a run may take if nothing is stated.
DEFAULT_SHARE = 0.5
# Bytes of the code and of its libraries, with their caches.
CODE_BYTES = 900 * 2**20
# Copies of an ensemble in memory while its modes are computed, itself included.
ENSEMBLE_COPIES = 4.5
# Copies of a simulation of the record: the nominal run, its derivatives, and the estimates.
RECORD_COPIES = 8
# Copies of the modes of a random start, while their number is chosen.
START_COPIES = 2
# Copies of the modes of a network, in float64: while they are orthogonalised, and as its weights.
MODE_COPIES = 4
# Simulates a number of random members.
Draw = Callable[[MemberSource, int], Ensemble]


@dataclass(frozen=True)
class MemoryPlan:
    """Bytes of memory, and where an ensemble is kept.

    Attributes:
        ensemble: bytes of the states of the ensemble.
        in_memory: largest memory of the run with the ensemble in memory, an estimate.
        on_disk: the same with the ensemble on disk.
        limit: memory that the run may take.
    """

    ensemble: int
    in_memory: int
    on_disk: int
    limit: int

    @property
    def is_on_disk(self) -> bool:
        """Whether the ensemble is kept on disk."""
        return self.in_memory > self.limit

    @property
    def peak(self) -> int:
        """Largest memory of the run."""
        return self.on_disk if self.is_on_disk else self.in_memory


def plan_memory(
    config: Config,
    values: int,
    samples: int,
    recorded: int,
    members: int,
    kept: int = 0,
    start_modes: int = 0,
) -> MemoryPlan:
    """Return the memory for an ensemble and the training on it.

    Args:
        config: with the limit and the settings of the network.
        values: number of values of a state.
        samples: number of samples of a member.
        recorded: number of samples of the recording.
        members: number of members.
        kept: number of members of another ensemble that is kept meanwhile.
        start_modes: number of modes of a random start.

    Raises:
        InputError: not even an ensemble on disk keeps within the limit.
    """
    stated = config.simulation.memory
    limit = (
        int(DEFAULT_SHARE * machine_memory())
        if stated is None
        else parse_memory(stated, config.where(KEY))
    )
    ensemble = 8 * values * samples * members
    modes = 8 * values * min(config.shred.modes, samples * members)
    states = RECORD_COPIES * recorded + START_COPIES * start_modes
    fixed = CODE_BYTES + 8 * values * states + MODE_COPIES * modes
    whole = 8 * values * samples
    work = max(min(ensemble, WORK_BYTES), min(whole, WORK_BYTES), min(ensemble, 2 * GROUP_BYTES))
    in_memory = fixed + ENSEMBLE_COPIES * ensemble + whole * kept
    plan = MemoryPlan(ensemble, math.ceil(in_memory), fixed + work, limit)
    if plan.is_on_disk and plan.on_disk > limit:
        raise InputError(
            f"the run needs about {memory_text(plan.on_disk)} even with the ensemble on disk, more "
            f"than {memory_text(limit)}",
            where=config.where(KEY),
            hint="increase simulation.memory, or choose a coarser grid, fewer samples "
            "(recording.every) or fewer shred.modes",
        )
    return plan


def memory_of(problem: Problem) -> MemoryPlan:
    """Return :func:`memory_of_run` of a recording."""
    episodes = (*problem.episodes, *problem.whole)
    recorded = sum(len(episode.times) for episode in episodes)
    return memory_of_run(problem.config, problem.system, len(problem.split.fit.times), recorded)


def memory_of_run(config: Config, system: System, fitted: int, recorded: int) -> MemoryPlan:
    """Return the memory for the larger of the two ensembles of a run, beside the other.

    Args:
        config: settings of the run.
        system: the simulator.
        fitted: number of samples of the fit window.
        recorded: number of samples of all episodes.

    Raises:
        InputError: not even ensembles on disk keep within the limit.
    """
    smaller, larger = sorted(_members(config))
    modes = fitted_modes(system) if system.axes and config.system.spread else 0
    return plan_memory(config, _values(system), fitted, recorded, larger, smaller, modes)


def bytes_on_disk(config: Config, system: System, fitted: int) -> int:
    """Return the bytes of both ensembles of a run, over a fit window of so many samples."""
    return 8 * _values(system) * fitted * sum(_members(config))


def _members(config: Config) -> tuple[int, int]:
    return config.simulation.members, config.surrogate.members


def _values(system: System) -> int:
    """Return the number of values of a state."""
    return len(system.fields) * math.prod(system.grid.shape)


def drawing(problem: Problem, name: str) -> Draw:
    """Return the function that simulates members of an ensemble, in memory or to disk.

    Args:
        problem: the recording.
        name: of the folder of these members.

    Raises:
        InputError: see :func:`memory_of`.
    """
    if not memory_of(problem).is_on_disk:
        return draw_ensemble
    scratch = problem.scratch

    def draw(source: MemberSource, members: int) -> Ensemble:
        return draw_ensemble_to_disk(source, members, scratch.folder(name), scratch.identity())

    return draw


def check_in_memory(problem: Problem) -> None:
    """Refuse an ensemble that is made in memory only, if it takes too much.

    Raises:
        InputError: it does.
    """
    plan = memory_of(problem)
    if plan.is_on_disk:
        raise InputError(
            "the simulator does not stay within bounds, and the states along the readings that "
            f"replace its ensemble take {memory_text(plan.in_memory)} of memory, more than "
            f"{memory_text(plan.limit)}",
            where=problem.config.where(KEY),
            hint="increase simulation.memory, or choose fewer simulation.members",
        )
