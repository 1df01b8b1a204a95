"""Read the runs of a black-box simulator and cut them into training segments."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.core.progress import stage
from dashred.inference.initial_state.analogs import window_misfits
from dashred.physics.runs.ensemble import Ensemble
from dashred.pipeline.problem import Problem

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

    states: Tensor
    ensemble: Ensemble
    held_out: int
    sha256: str

    @property
    def sample_states(self) -> Tensor:
        """States on which the columns of the library are compared, ``(state, field, *grid)``."""
        states = self.ensemble.states.flatten(0, 1)
        return states[:: max(1, len(states) // LIBRARY_STATES)]

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
        states, sha256 = snapshots.read(settings.members, every, problem.rng("snapshots"))
        members, samples = states.shape[:2]
        length = segment_length(problem, members, samples)
        each = samples // length
        cut = states[:, : each * length].unflatten(1, (each, length)).flatten(0, 1)
        ensemble = Ensemble(problem.times[:length], cut, torch.zeros((len(cut), 0)).double())
        share = settings.held_out / settings.members
        held_out = _held_out(members, each, share)
        report(
            1.0, f"{members} runs of {samples} samples, cut into {len(cut)} segments of {length}"
        )
    return SnapshotRuns(states, ensemble, held_out, sha256)


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
    read = problem.operator(fit)(runs.states)[:, :, None]
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
