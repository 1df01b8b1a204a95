"""Read the runs of a black-box simulator and cut them into training segments."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.core.progress import stage
from dashred.inference.initial_state.analogs import window_misfits
from dashred.physics.black_box.snapshot_reader import SnapshotReader
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.stored_states import States, StoredStates, cut, each_state, thinned
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensemble_memory import MemoryPlan, plan_memory

# Runs are cut into at least the first number of segments if possible; the second is required.
TARGET_SEGMENTS, MIN_SEGMENTS = 12, 4
# Largest number of segments for validation, at most a quarter of all.
VALIDATION_RUNS = 8
# Number of states on which the columns of the library are compared.
LIBRARY_STATES = 400


@dataclass(frozen=True)
class SnapshotRuns:
    """The runs and their segments.

    Attributes:
        states: full runs at the step of the clock, ``(member, time, field, *grid)``.
        ensemble: the same cut into segments, with validation segments last.
        held_out: number of validation segments at its end.
        sha256: hash of the snapshots.
    """

    states: States
    ensemble: Ensemble
    held_out: int
    sha256: str

    @property
    def sample_states(self) -> Tensor:
        """States on which the columns of the library are compared, ``(state, field, *grid)``."""
        return thinned(self.ensemble.states, LIBRARY_STATES)

    def configured(self, config: Config) -> Config:
        """Return the configuration with the actual number of segments."""
        members, settings = len(self.ensemble.states), config.simulation
        counted = replace(settings, members=members, held_out=self.held_out)
        return replace(config, simulation=counted)


@torch.no_grad()
def read_runs(problem: Problem, seconds: dict[str, float]) -> SnapshotRuns:
    """Read the runs and cut them into segments no longer than the fit window.

    Raises:
        InputError: a value is not finite, or the runs are too few or too short.
    """
    snapshots, settings = problem.snapshots, problem.config.simulation
    assert snapshots is not None
    every = float(problem.times[1] - problem.times[0])
    with stage("read the snapshots", seconds) as report:
        states, sha256 = _read(problem, every)
        members, samples = states.shape[:2]
        length = segment_length(problem, members, samples)
        each, segments = samples // length, cut(states, length)
        count = len(segments)
        ensemble = Ensemble(problem.times[:length], segments, torch.zeros((count, 0)).double())
        share = settings.held_out / settings.members
        held_out = _held_out(members, each, share)
        kept = "" if isinstance(states, Tensor) else ", read in parts"
        report(
            1.0,
            f"{members} runs of {samples} samples, cut into {count} segments of {length}{kept}",
        )
    return SnapshotRuns(states, ensemble, held_out, sha256)


def _read(problem: Problem, every: float) -> tuple[States, str]:
    """Return the runs and the hash of their values; runs that take too much stay on disk."""
    snapshots, members = problem.snapshots, problem.config.simulation.members
    assert snapshots is not None
    rng = problem.rng("snapshots")
    if not memory_of_snapshots(problem, every).is_on_disk:
        return snapshots.read(members, every, rng)
    reader = SnapshotReader.of(snapshots, members, every, rng)
    return StoredStates(reader, range(reader.shape[0])), reader.sha256()


def memory_of_snapshots(problem: Problem, every: float) -> MemoryPlan:
    """Return the memory for the runs and the training on them.

    Args:
        problem: the recording.
        every: step of the clock.

    Raises:
        InputError: not even runs that are read in parts keep within the limit.
    """
    snapshots = problem.snapshots
    assert snapshots is not None
    return plan_memory(
        problem.config,
        len(problem.system.fields) * math.prod(problem.system.grid.shape),
        snapshots.samples_at(every),
        len(problem.times),
        min(problem.config.simulation.members, snapshots.members),
    )


def segment_length(problem: Problem, members: int, samples: int) -> int:
    """Return the number of samples of the segments.

    Raises:
        InputError: the runs are too few or too short.
    """
    assert problem.snapshots is not None
    lags, every = problem.config.shred.lags, float(problem.times[1] - problem.times[0])
    length = _length(members, samples, len(problem.split.fit.times), lags)
    if members * (samples // length) >= MIN_SEGMENTS and samples >= length:
        return length
    raise InputError(
        f"{members} runs of {samples} snapshots each, at a step of {every:g}, "
        "are too few for training and validation",
        where=problem.snapshots.path,
        hint=f"at least {MIN_SEGMENTS} segments of {lags + 1} samples (shred.lags + 1) are needed: "
        "give more or longer runs",
    )


@torch.no_grad()
def nearest_run(problem: Problem, runs: SnapshotRuns) -> Tensor | None:
    """Return the part of a run that fits the fit sensors best, ``(time, field, *grid)``.

    It covers the full record if the run is long enough, or else the fit window; None if no run is
    as long as the fit window.
    """
    fit = problem.split.fit
    window, total = len(fit.times), len(problem.times)
    if runs.states.shape[1] < window:
        return None
    read = each_state(problem.operator(fit), runs.states)[:, :, None]
    noise = problem.noise_of(fit.names).clamp(min=1e-12)
    misfit = window_misfits(read, torch.from_numpy(fit.values), noise)[:, :, 0]
    whole = misfit[:, : runs.states.shape[1] - total + 1]
    chosen = whole if whole.numel() else misfit
    member, begin = divmod(int(chosen.argmin()), chosen.shape[1])
    return runs.states[member, begin : begin + (total if whole.numel() else window)]


def _length(members: int, samples: int, window: int, lags: int) -> int:
    """Return the samples of a segment: the fit window, or fewer to get enough segments."""
    shortest = lags + 1
    if members * (samples // max(1, min(window, samples))) >= TARGET_SEGMENTS:
        return min(window, samples)
    each = -(-TARGET_SEGMENTS // members)
    return max(shortest, min(window, samples, samples // each))


def _held_out(members: int, each: int, share: float) -> int:
    """Return the number of validation segments, from whole runs if there are enough."""
    size, of = (each, members) if members >= MIN_SEGMENTS else (1, members * each)
    return size * min(of - 2, max(2, round(share * of), min(VALIDATION_RUNS, of // 4)))
