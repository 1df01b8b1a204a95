"""Blocks of the columns of a large Jacobian, which the workers of a cluster compute.

Each worker integrates the trajectory, which is a small part of the work, and its blocks of columns
along it. The blocks depend on the problem alone, so that the bits of the Jacobian depend neither
on the number of workers nor on whether there is a cluster.
"""

from __future__ import annotations

import time
from collections import Counter

import torch
from torch import Tensor

from dashred.core.budget import NEVER, Deadline
from dashred.core.cluster.calls import ClusterCalls, cluster_in_use
from dashred.core.threads import in_threads
from dashred.core.work import add_work, counted
from dashred.inference.forward.columns.tangent_columns import TangentColumns, TangentPoint
from dashred.inference.forward.episodes import without_padding
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.solvers.schedule import count_steps
from dashred.physics.tangents.spectral_columns.threads import columns_together

# Columns times their steps and the values of a state from which a Jacobian is divided. On a core of
# an AMD EPYC so many took 0.7 s on a line. A call takes some hundredths of a second.
LARGE = 2e7
# Columns of a block times the values of a state, unless a group has more. The last block may be
# longer.
BLOCK_POINTS = 2**17


def is_large(columns: TangentColumns) -> bool:
    """Return whether a Jacobian is worth the workers of a cluster."""
    simulator = columns.simulator
    clocks = [without_padding(clock).tolist() for clock in columns.times.T]
    steps = sum(count_steps(clock, simulator.tangent.dt) for clock in clocks)
    return simulator.has_chunks and columns.count * steps * simulator.values >= LARGE


def column_blocks(columns: TangentColumns) -> list[slice]:
    """Return the blocks of columns that are integrated and read together."""
    count, values = columns.count, columns.simulator.values
    group = columns_together(count, values)
    size = group * max(1, BLOCK_POINTS // (group * values))
    if count < 2 * size or not is_large(columns):
        return [slice(0, count)]
    # The last block is no shorter than the others: all are read one sample at a time.
    begins = range(0, count - size + 1, size)
    return [slice(b, e) for b, e in zip(begins, [*begins[1:], count], strict=True)]


def compute_columns(
    columns: TangentColumns, point: TangentPoint, deadline: Deadline = NEVER
) -> Tensor:
    """Return all columns at a point, ``(time, sensor, column)``, from a cluster if one is in use.

    Args:
        columns: of the forward model.
        point: the point.
        deadline: time at which the integration ends.

    Raises:
        OutOfTimeError: the deadline is over.
        InputError: the scheduler of the cluster is lost, or its workers die.
    """
    blocks, calls = column_blocks(columns), cluster_in_use()
    if calls is None or len(blocks) == 1:
        return columns.at(point, blocks, deadline)
    return _on_workers(calls, columns, point, blocks, deadline)


def _on_workers(
    calls: ClusterCalls,
    columns: TangentColumns,
    point: TangentPoint,
    blocks: list[slice],
    deadline: Deadline,
) -> Tensor:
    groups = min(calls.count, len(blocks))
    edges = [round(i * len(blocks) / groups) for i in range(groups + 1)]
    kept = columns.simulator, columns.start, columns.sensors
    own = columns.tendency, columns.times, columns.forcing
    found: dict[int, tuple[Tensor, Counter[str]]] = {}

    def run(i: int) -> None:
        seconds = deadline.at - time.monotonic()
        mine = blocks[edges[i] : edges[i + 1]]
        found[i] = calls.call_with(kept, columns_on_worker, own, point, mine, seconds)

    for _ in in_threads(run, groups, groups):
        deadline.check()
    for _, work in found.values():
        add_work(work)
    return torch.cat([found[i][0] for i in range(groups)], dim=-1)


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
