"""Blocks of the columns of a large Jacobian, computed side by side.

Workers of a cluster compute them, or copies of this process if it may use several threads. Each
integrates the trajectory, which is a small part of the work, and its blocks of columns along it.
The blocks depend on the problem alone, so that the bits of the Jacobian depend neither on where
they are computed nor on how many compute them.
"""

from __future__ import annotations

import time
from collections import Counter
from functools import partial
from itertools import pairwise

import torch
from torch import Tensor

from dashred.core.budget import NEVER, Deadline
from dashred.core.cluster.calls import ClusterCalls, cluster_in_use
from dashred.core.threads import in_threads, thread_count
from dashred.core.work import add_work, counted
from dashred.inference.forward.columns.forks import can_fork, in_forks
from dashred.inference.forward.columns.tangent_columns import TangentColumns, TangentPoint
from dashred.inference.forward.episodes import without_padding
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import BLOCK_SIZE, Simulator
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.solvers.schedule import count_steps
from dashred.physics.tangents.tangent_linear import columns_together

# Columns times their steps and the values of a state from which a Jacobian is divided. So many take
# 0.3 s on a plane. A call, or a copy of the process, takes some hundredths of a second.
LARGE = 8e6


def is_large(columns: TangentColumns) -> bool:
    """Return whether a Jacobian is worth several processes."""
    simulator = columns.simulator
    clocks = [without_padding(clock).tolist() for clock in columns.times.T]
    steps = sum(count_steps(clock, simulator.tangent.dt) for clock in clocks)
    return simulator.has_chunks and columns.count * steps * simulator.values >= LARGE


def column_blocks(columns: TangentColumns) -> list[slice]:
    """Return the blocks of columns that are integrated and read together."""
    values = columns.simulator.values
    chunks = columns_together(columns.count, values)
    # Each is read one sample at a time, whichever others are.
    if not is_large(columns) or min(map(len, chunks)) * values < BLOCK_SIZE:
        return [slice(0, columns.count)]
    return [slice(chunk.start, chunk.stop) for chunk in chunks]


def compute_columns(
    columns: TangentColumns, point: TangentPoint, deadline: Deadline = NEVER
) -> Tensor:
    """Return all columns at a point, ``(time, sensor, column)``.

    Args:
        columns: of the forward model.
        point: the point.
        deadline: time at which the integration ends.

    Raises:
        OutOfTimeError: the deadline is over.
        InputError: the scheduler of the cluster is lost, or its workers die.
    """
    blocks, calls = column_blocks(columns), cluster_in_use()
    if len(blocks) > 1 and calls is not None:
        return _on_workers(calls, columns, point, blocks, deadline)
    if len(blocks) > 1 and thread_count() > 1 and can_fork():
        return _in_forks(columns, point, blocks, deadline)
    return columns.at(point, blocks, deadline)


def _on_workers(
    calls: ClusterCalls,
    columns: TangentColumns,
    point: TangentPoint,
    blocks: list[slice],
    deadline: Deadline,
) -> Tensor:
    groups = _groups(blocks, calls.count)
    kept = columns.simulator, columns.start, columns.sensors
    own = columns.tendency, columns.times, columns.forcing
    found: dict[int, tuple[Tensor, Counter[str]]] = {}

    def run(i: int) -> None:
        seconds = deadline.at - time.monotonic()
        found[i] = calls.call_with(kept, columns_on_worker, own, point, groups[i], seconds)

    for _ in in_threads(run, len(groups), len(groups)):
        deadline.check()
    for _, work in found.values():
        add_work(work)
    return torch.cat([found[i][0] for i in range(len(groups))], dim=-1)


def _groups(blocks: list[slice], most: int) -> list[list[slice]]:
    """Return the blocks in at most so many groups of similar sizes."""
    count = min(most, len(blocks))
    edges = [round(i * len(blocks) / count) for i in range(count + 1)]
    return [blocks[first:last] for first, last in pairwise(edges)]


def _in_forks(
    columns: TangentColumns, point: TangentPoint, blocks: list[slice], deadline: Deadline
) -> Tensor:
    groups = _groups(blocks, thread_count())

    def task(mine: list[slice]) -> tuple[Tensor, Counter[str]]:
        with counted() as work, torch.no_grad():
            return columns.at(point, mine, deadline), work

    found = in_forks([partial(task, group) for group in groups])
    for _, work in found:
        add_work(work)
    return torch.cat([part for part, _ in found], dim=-1)


def columns_on_worker(
    simulator: Simulator,
    start: StartModel,
    sensors: SensorBlock,
    own: tuple[LawBlock, Tensor, ForcingBlock | None],
    point: TangentPoint,
    blocks: list[slice],
    seconds: float,
) -> tuple[Tensor, Counter[str]]:
    """Return some columns, and the work that they were.

    Args:
        simulator: part of :class:`TangentColumns`, as are the start and the sensors.
        start: u₀(z).
        sensors: H.
        own: law, times and forcing, which change more often.
        point: the point.
        blocks: the columns.
        seconds: time after which the integration ends.
    """
    law, times, forcing = own
    columns = TangentColumns(simulator, start, law, sensors, times, forcing)
    with counted() as work, torch.no_grad():
        return columns.at(point, blocks, Deadline(time.monotonic() + seconds)), work
