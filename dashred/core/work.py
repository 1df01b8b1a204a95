"""Count the work of a process, which tells what an analysis costs on any machine.

Seconds depend on the machine and on what else runs there. The counts do not, so a test can compare
them with those of an earlier version of the code.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Lock

# Time steps of trajectories, and of columns of Jacobians: derivatives of a trajectory.
TRAJECTORY_STEPS, COLUMN_STEPS = "trajectory steps", "column steps"
# The same, times the number of values of a state.
TRAJECTORY_VALUES, COLUMN_VALUES = "trajectory values", "column values"
# Fourier transforms of one field on the whole grid, forward or back, and the same, times the number
# of grid points.
TRANSFORMS, TRANSFORM_VALUES = "transforms", "transform values"

_done: Counter[str] = Counter()
_lock = Lock()
# What counts the work of this thread.
_counter: ContextVar[Counter[str]] = ContextVar("work", default=_done)


def count_trajectories(rows: int, steps: int, values: int) -> None:
    """Count trajectories.

    Args:
        rows: number of trajectories.
        steps: time steps of each.
        values: number of values of a state.
    """
    add_work({TRAJECTORY_STEPS: rows * steps, TRAJECTORY_VALUES: rows * steps * values})


def count_columns(columns: int, steps: int, values: int) -> None:
    """Count columns of a Jacobian; see :func:`count_trajectories`."""
    add_work({COLUMN_STEPS: columns * steps, COLUMN_VALUES: columns * steps * values})


def count_transforms(count: int, points: int) -> None:
    """Count Fourier transforms.

    Args:
        count: number of transforms of one field.
        points: number of grid points.
    """
    add_work({TRANSFORMS: count, TRANSFORM_VALUES: count * points})


def add_work(counts: Mapping[str, int]) -> None:
    """Count work by name, for example that of another process."""
    # Columns are integrated in threads.
    with _lock:
        _counter.get().update(counts)


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """Count the work of this thread in a block apart from all other work."""
    work: Counter[str] = Counter()
    token = _counter.set(work)
    try:
        yield work
    finally:
        _counter.reset(token)


def work_done() -> dict[str, int]:
    """Return the counts since the start of the process."""
    return dict(_done)
