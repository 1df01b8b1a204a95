"""The runs of a black-box simulator, as SHRED learns from them and as they stand by themselves."""

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

# Runs are cut until there are so many trajectories, and there must be so many.
ENOUGH, FEWEST = 12, 4
# So many runs measure what was learnt, of up to four times as many.
MEASURING = 8
# States on which the library's columns are compared.
COMPARED = 400


@dataclass(frozen=True)
class SnapshotRuns:
    """The runs that were read.

    Attributes:
        states: whole runs on the clock's step, ``(member, time, field, *grid)``.
        ensemble: the same cut into stretches, the runs that are not trained on last.
        held_out: so many stretches at its end are not trained on.
        sha256: hash of what was read.
    """

    states: Tensor
    ensemble: Ensemble
    held_out: int
    sha256: str

    @property
    def some(self) -> Tensor:
        """States on which the library's columns are compared, ``(state, field, *grid)``."""
        states = self.ensemble.states.flatten(0, 1)
        return states[:: max(1, len(states) // COMPARED)]

    def configured(self, config: Config) -> Config:
        """Return the settings with the number of trajectories that there are."""
        members, settings = len(self.ensemble.states), config.simulation
        counted = replace(settings, members=members, held_out=self.held_out)
        return replace(config, simulation=counted)


@torch.no_grad()
def read_runs(problem: Problem, seconds: dict[str, float]) -> SnapshotRuns:
    """Read the runs and cut them into stretches no longer than the fit window.

    Raises:
        InputError: a value is not finite, or the runs are too few or too short.
    """
    snapshots, settings = problem.snapshots, problem.config.simulation
    assert snapshots is not None
    every = float(problem.times[1] - problem.times[0])
    with stage("read the snapshots", seconds) as report:
        states, sha256 = snapshots.read(settings.members, every, problem.rng("snapshots"))
        members, samples = states.shape[:2]
        length = stretch_length(problem, members, samples)
        each = samples // length
        cut = states[:, : each * length].unflatten(1, (each, length)).flatten(0, 1)
        ensemble = Ensemble(problem.times[:length], cut, torch.zeros((len(cut), 0)).double())
        share = settings.held_out / settings.members
        held_out = _held_out(members, each, share)
        report(1.0, f"{members} runs of {samples}, as {len(cut)} stretches of {length} samples")
    return SnapshotRuns(states, ensemble, held_out, sha256)


def stretch_length(problem: Problem, members: int, samples: int) -> int:
    """Return samples of the stretches that runs on the clock's step are cut into.

    Raises:
        InputError: the runs are too few or too short.
    """
    assert problem.snapshots is not None
    lags, every = problem.config.shred.lags, float(problem.times[1] - problem.times[0])
    length = _length(members, samples, len(problem.split.fit.times), lags)
    if members * (samples // length) >= FEWEST and samples >= length:
        return length
    raise InputError(
        f"{members} runs of {samples} snapshots each, at the clock's step of {every:g}, "
        "are too few to learn from and to check what was learnt",
        where=problem.snapshots.path,
        hint=f"at least {FEWEST} stretches of {lags + 1} are needed (shred.lags + 1): give more "
        "or longer runs",
    )


@torch.no_grad()
def nearest_run(problem: Problem, runs: SnapshotRuns) -> Tensor | None:
    """Return the stretch of the runs that is nearest to the fit sensors, from any time on.

    ``(time, field, *grid)``, over the whole record if the run goes on so long, else over the fit
    window; None if no run is as long as that.
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
    """Return samples of a stretch: of the fit window, or fewer where there would be too few."""
    shortest = lags + 1
    if members * (samples // max(1, min(window, samples))) >= ENOUGH:
        return min(window, samples)
    each = -(-ENOUGH // members)
    return max(shortest, min(window, samples, samples // each))


def _held_out(members: int, each: int, share: float) -> int:
    """Return the stretches not trained on: of whole runs, where there are enough of these."""
    size, of = (each, members) if members >= FEWEST else (1, members * each)
    return size * min(of - 2, max(2, round(share * of), min(MEASURING, of // 4)))
