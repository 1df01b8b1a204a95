"""Errors of rounding, and of tolerances, in the results of a program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dashred.physics.external.state_batch import Array, StateBatch

# Results that should be equal may differ by this many rounding errors of the largest value.
ROUNDING_ERRORS = 32
# Length of a line of states on which results show their rounding, relative to the states.
CLOSE, CLOSE_STATES = 1e-5, 8
GOLDEN = (5**0.5 - 1) / 2
DOUBLE = float(np.finfo(np.float64).eps) / 2
SINGLE_PRECISION = float(np.finfo(np.float32).eps) / 2


def measured_rounding(step: Callable[[StateBatch], Array | None], start: StateBatch) -> float:
    """Return the relative error of rounding and of tolerances, from the results of close states.

    Along a short line of states a result is a cubic but for these errors. The places on the line
    are irregular, because equal distances may be whole numbers of the last digit.

    Args:
        step: returns the states after a step, ``(batch, field, *grid)``, or None.
        start: one state.
    """
    sizes = np.random.default_rng(0).uniform(0.5, 1.5, start.states.shape)
    line = CLOSE * sizes * scale_of(start.states)
    places = np.arange(CLOSE_STATES) * GOLDEN % 1
    states = start.states + places.reshape(-1, *[1] * (line.ndim - 1)) * line
    same = start.take([0] * CLOSE_STATES)
    values = step(replace(same, states=states))
    if values is None or not np.isfinite(values).all():
        return DOUBLE
    flat = (values - values[0]).reshape(CLOSE_STATES, -1)
    _, squares, *_ = np.linalg.lstsq(np.vander(places, 4), flat, rcond=None)
    errors = np.sqrt(squares / (CLOSE_STATES - 4)).reshape(values.shape[1:])
    return max(DOUBLE, float((errors / scale_of(values).max(axis=0)).max()))


def scale_of(states: Array) -> Array:
    """Return the largest value of each field, or of the state for a field of zeros."""
    largest = np.abs(states).max(axis=tuple(range(2, states.ndim)), keepdims=True)
    return np.where(largest > 0, largest, np.abs(states).max() or 1.0)


def equal(a: Array, b: Array, rounding: float) -> bool:
    """Whether two batches of states are equal to within rounding, field by field."""
    grid = tuple(range(2, a.ndim))
    scale = np.abs(b).max(axis=(0, *grid), keepdims=True)
    with np.errstate(invalid="ignore"):
        return bool(((a == b) | (np.abs(a - b) <= ROUNDING_ERRORS * rounding * scale)).all())
