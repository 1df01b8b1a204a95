"""Snapshots in place of a simulator: are there enough, and do they speak of what was recorded?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from dashred.pipeline.check.agreement import sizes_compared
from dashred.pipeline.check.remark import Remark, counted
from dashred.pipeline.problem import Problem
from dashred.pipeline.snapshots.snapshot_runs import stretch_length

# Runs that are read: enough for the size of what they show.
READ = 8


@torch.no_grad()
def about_snapshots(problem: Problem) -> Iterator[Remark]:
    """Tell what SHRED will learn from, and how it compares with the recording in size.

    Raises:
        InputError: the runs are too few or too short, or one that is read is not finite.
    """
    snapshots, wanted = problem.snapshots, problem.config.simulation.members
    assert snapshots is not None
    every = float(problem.times[1] - problem.times[0])
    used = min(wanted, snapshots.members)
    samples = snapshots.samples_at(every)
    length = stretch_length(problem, used, samples)
    of = "" if used == snapshots.members else f", of {snapshots.members} that there are"
    yield Remark(
        f"{counted(used, 'run')} of {samples} snapshots at the clock's step of {every:.6g}{of}, "
        f"cut into stretches of {length}"
    )
    states, _ = snapshots.read(min(READ, used), every, np.random.default_rng(problem.config.seed))
    fit = problem.split.fit
    read = problem.operator(fit)(states.flatten(0, 1))
    yield from sizes_compared(fit.names, torch.from_numpy(fit.values), read, "snapshots")
    yield Remark("What a run can tell of them is less than of equations: see docs/black-box.md")
