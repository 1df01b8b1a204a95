"""Sensors that average over an interval of time, such as a logger's mean since the last sample.

The mean of y over the time T before a sample at t is, by a Taylor expansion about the middle::

    mean y = y(s) + T²/24 y''(s) + O(T⁴)        s = t - T/2

The reading therefore belongs to the time s, and the sensor reads the let ``y + T²/24 y''``. The
derivative y'' is taken along the equations, in which the inputs count as constant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dashred.core.errors import InputError
from dashred.core.stated.average import KEY, parse_average
from dashred.data.episodes import Episode, Episodes, name_episode_in_errors
from dashred.data.recording import Recording
from dashred.data.sensors import check_named_sensors
from dashred.physics.expressions.algebra import Expr, Number, add, multiply, names, to_text
from dashred.physics.expressions.differentiate import NotDifferentiableError, differentiate
from dashred.physics.expressions.free_names import free_name
from dashred.physics.system import System

# Steps between samples that differ by more than this share have no common interval.
EVEN = 0.01


def with_averages(
    system: System, episodes: Episodes, stated: Any, where: Callable[[str], str]
) -> tuple[System, Episodes]:
    """Return a system and a recording in which readings of averages are instantaneous.

    Args:
        system: the simulator.
        episodes: the recording.
        stated: ``recording.average``.
        where: returns the location of a dotted key.

    Raises:
        InputError: the key is invalid, names no sensor, or has no common interval; or the sensors
            of a system with axes average over different times.
    """
    by_name = parse_average(stated, where)
    for name in filter(None, by_name):
        check_named_sensors(episodes.sensors, [name], KEY, where(f"{KEY}.{name}"))
    spans, longest = [], 0.0
    for column, sensor in enumerate(episodes.sensors):
        whole = by_name.get("", 0.0)
        span = by_name.get(sensor.name, by_name.get(sensor.reads, whole))
        spans.append(_interval(episodes, column, where(KEY)) if span is None else span)
        longest = max(longest, spans[-1])
    if not longest:
        return system, episodes
    if system.axes and len(set(spans)) > 1:
        what = "the sensors of a system with axes average over different times"
        raise InputError(what, where=where(KEY), hint="give one time for all of them")
    sensors = list(episodes.sensors)
    for column, (sensor, span) in enumerate(zip(episodes.sensors, spans, strict=True)):
        if span:
            system, reads = _with_mean(system, sensor.reads, span)
            sensors[column] = replace(sensor, reads=reads)
    parts = []
    for part in episodes.episodes:
        with name_episode_in_errors(part.name):
            shifted = _shifted(part.recording, spans)
        parts.append(Episode(part.name, replace(shifted, sensors=tuple(sensors))))
    return system, replace(episodes, episodes=tuple(parts))


def _interval(episodes: Episodes, column: int, where: str) -> float:
    """Return the time between the readings of a sensor."""
    steps = np.concatenate(
        [
            np.diff(part.recording.times[np.isfinite(part.recording.values[:, column])])
            for part in episodes.episodes
        ]
    )
    # A gap does not make a clock uneven.
    steps = steps[steps < 1.5 * np.median(steps)] if len(steps) else steps
    if not len(steps) or np.ptp(steps) > EVEN * np.median(steps):
        what = f"sensor {episodes.sensors[column].name!r} has no common interval between samples"
        raise InputError(what, where=where, hint="give the time over which it averages")
    return float(np.median(steps))


def _with_mean(system: System, reads: str, span: float) -> tuple[System, str]:
    """Return the system with a let of the mean of a quantity, and its name."""
    name = free_name(f"mean_of_{reads}", system.names)
    config = system.config
    whole = system.without_lets(system.parse(reads, f"system.let.{reads}"))
    mean = add([whole, multiply((Number(span**2 / 24), _second_derivative(system, whole)))])
    units = dict(config.units)
    if reads in units:
        units[name] = units[reads]
    let = {**config.let, name: to_text(mean)}
    return system.with_config(replace(config, let=let, units=units)), name


def _second_derivative(system: System, expr: Expr) -> Expr:
    """Return y'' along the equations; 0 where it is unknown, or depends on the inputs."""
    if system.axes:
        return Number(0.0)
    try:
        found = _along(system, _along(system, expr))
    except NotDifferentiableError:
        return Number(0.0)
    return Number(0.0) if names(found) & system.clock else found


def _along(system: System, expr: Expr) -> Expr:
    """Return the derivative of a quantity along the equations, with constant inputs."""
    terms = [
        multiply((differentiate(expr, field), system.without_lets(tendency)))
        for field, tendency in system.equations.items()
    ]
    return add([*terms, differentiate(expr, "t")])


def _shifted(recording: Recording, spans: list[float]) -> Recording:
    """Return a recording in which every reading is at the middle of its interval."""
    times = np.unique(np.concatenate([recording.times - span / 2 for span in set(spans)]))
    values = np.full((len(times), len(spans)), np.nan)
    for column, span in enumerate(spans):
        rows = np.searchsorted(times, recording.times - span / 2)
        values[rows, column] = recording.values[:, column]
    kept = np.isfinite(values).any(axis=1) if len(set(spans)) > 1 else slice(None)
    return replace(recording, times=times[kept], values=values[kept])
