"""Readings at the stop of a sensor: they tell an inequality, and nothing of the noise.

A sensor with stops reads a quantity such as ``clip(x, 0, 10)``. Where the state is beyond a stop,
the clipped quantity has the value of the reading, so that the residual is zero; elsewhere the
residual is the distance from the stop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.data.recording import Recording
from dashred.physics.expressions.algebra import Expr, Where, children, names
from dashred.physics.system import System

Mask = NDArray[np.bool_]


def has_stops(system: System, reads: str) -> bool:
    """Return whether a quantity changes its form with the fields: ``clip``, ``min`` or ``max``."""
    expr = system.without_lets(system.parse(reads, f"system.let.{reads}"))
    return _has_branches(expr, frozenset(system.fields))


def at_stop(recording: Recording) -> Mask | None:
    """Return which readings are at a stop, ``(time, sensor)``; None if no sensor has stops.

    They are equal to the largest or the smallest reading, if that occurs more than once.
    """
    if not any(sensor.has_stops for sensor in recording.sensors):
        return None
    found = np.zeros(recording.values.shape, dtype=bool)
    for column, sensor in enumerate(recording.sensors):
        if sensor.has_stops:
            found[:, column] = values_at_stop(recording.values[:, column])
    return found


def values_at_stop(values: NDArray[np.float64]) -> Mask:
    """Return which values are the largest or the smallest, if that occurs more than once."""
    found = np.zeros(values.shape, dtype=bool)
    if not np.isfinite(values).any():
        return found
    for stop in (np.nanmax(values), np.nanmin(values)):
        same = values == stop
        if same.sum() > 1:
            found |= same
    return found


def _has_branches(expr: Expr, fields: frozenset[str]) -> bool:
    if isinstance(expr, Where) and names(expr.condition) & fields:
        return True
    return any(_has_branches(child, fields) for child in children(expr))
