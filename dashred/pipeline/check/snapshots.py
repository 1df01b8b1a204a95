"""Checks of snapshots: their number, and their amplitude against the recording's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from dashred.core.formatting import plural
from dashred.physics.black_box.snapshot_reader import SnapshotReader
from dashred.physics.runs.stored_states import StoredStates, each_state
from dashred.pipeline.check.agreement import compare_amplitudes
from dashred.pipeline.check.memory import memory_remark
from dashred.pipeline.check.remark import Remark
from dashred.pipeline.problem import Problem
from dashred.pipeline.snapshots.snapshot_runs import memory_of_snapshots, segment_length

# Largest number of runs that are read to estimate amplitudes.
MAX_RUNS = 8


@torch.no_grad()
def snapshots_remarks(problem: Problem) -> Iterator[Remark]:
    """Describe the training data of SHRED and compare amplitudes with the recording.

    Raises:
        InputError: the runs are too few or too short, or contain values that are not finite.
    """
    snapshots, wanted = problem.snapshots, problem.config.simulation.members
    assert snapshots is not None
    every = float(problem.times[1] - problem.times[0])
    used = min(wanted, snapshots.members)
    samples = snapshots.samples_at(every)
    length = segment_length(problem, used, samples)
    of = "" if used == snapshots.members else f" (of {snapshots.members} runs)"
    yield Remark(
        f"{plural(used, 'run')} of {samples} snapshots at a step of {every:.6g}{of}, "
        f"cut into segments of {length}"
    )
    yield memory_remark(memory_of_snapshots(problem, every), "the set of runs")
    rng = np.random.default_rng(problem.config.seed)
    reader = SnapshotReader.of(snapshots, min(MAX_RUNS, used), every, rng)
    fit = problem.split.fit
    states = StoredStates(reader, range(reader.shape[0]))
    read = each_state(problem.operator(fit), states).flatten(0, 1)
    values = torch.from_numpy(fit.values)
    yield from compare_amplitudes(fit.sensors, values, read, problem.noise, "snapshots")
    yield Remark("Snapshots allow fewer conclusions than equations: see docs/black-box.md")
