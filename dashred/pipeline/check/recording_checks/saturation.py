"""Sensors that seem to saturate: many readings are equal to the largest or the smallest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dashred.data.recording import Recording
from dashred.pipeline.check.remark import Remark, warning

# Share of the readings at a stop that causes a warning, and samples in a row.
SHARE, IN_A_ROW = 0.02, 3
# How many times as often as any other value: rounded readings repeat all values.
RATIO = 4


def saturated(recording: Recording) -> Iterator[Remark]:
    """Warn of sensors that may saturate and are not said to.

    A quantity may well rest at 0, and an entire trace at one value.
    """
    for sensor, values in zip(recording.sensors, recording.values.T, strict=True):
        if sensor.has_stops:
            continue
        known = values[np.isfinite(values)]
        stops = [stop for stop in _ends(known) if stop and _is_stop(known, stop)]
        if not stops:
            continue
        listed = [f"{stop:g}" for stop in stops]
        one = "min" if stops[0] > np.median(known) else "max"
        function = "clip" if len(stops) > 1 else one
        read = f"let: {{{sensor.name}: {function}({', '.join(['FIELD', *listed])})}}"
        yield warning(
            f"Many readings of {sensor.name} are exactly {' or '.join(listed)}: it may saturate",
            f"if so, it reads a let with the stops: give the field another name, and {read}",
        )


def _ends(values: NDArray[np.float64]) -> list[float]:
    if not values.size or values.min() == values.max():
        return []
    return [float(values.min()), float(values.max())]


def _is_stop(values: NDArray[np.float64], stop: float) -> bool:
    at = values == stop
    if at.mean() < SHARE or not np.convolve(at, np.ones(IN_A_ROW), "valid").max() >= IN_A_ROW:
        return False
    others = values[(values != values.min()) & (values != values.max())]
    most = int(np.unique(others, return_counts=True)[1].max()) if others.size else len(values)
    return int(at.sum()) >= RATIO * most
