"""Sensors with an unknown gain and offset: they become uncertain parameters of what is read.

A sensor of the quantity y reads ``gain*y + offset``. Both are fitted together with the state, like
every parameter with a spread.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dashred.core.stated.calibration import KEY, StatedPart, parse_calibration
from dashred.data.episodes import Episodes, with_sensors
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor, check_named_sensors
from dashred.physics.expressions.algebra import Name, add, multiply, summands, to_text
from dashred.physics.expressions.free_names import take_name
from dashred.physics.system import System

# The spread of a gain of which nothing is known, as a share of its value, and that of an offset, as
# a share of the rms of the readings.
GAIN_SPREAD, OFFSET_SPREAD = 1.0, 3.0


@dataclass(frozen=True)
class Calibrated:
    """A system and a recording whose calibrated sensors read lets of their own.

    Attributes:
        system: with a gain and an offset as parameters.
        episodes: with sensors that read them.
        parameters: name of the sensor by parameter.
    """

    system: System
    episodes: Episodes
    parameters: Mapping[str, str] = field(default_factory=dict)


def with_calibration(
    system: System,
    episodes: Episodes,
    fitted: Sequence[Recording],
    stated: Any,
    where: Callable[[str], str],
) -> Calibrated:
    """Return a system with the unknown gains and offsets of sensors as uncertain parameters.

    Args:
        system: the simulator.
        episodes: the recording.
        fitted: the parts of the recording that are fitted.
        stated: ``recording.calibration``.
        where: returns the location of a dotted key.

    Raises:
        InputError: the key is invalid, or names neither a sensor nor what one reads.
    """
    by_name = parse_calibration(stated, where)
    for name, parts in by_name.items():
        place = where(f"{KEY}.{name}.{next(iter(parts))}")
        check_named_sensors(episodes.sensors, [name], KEY, place)
    sensors, parameters = list(episodes.sensors), dict[str, str]()
    for column, sensor in enumerate(sensors):
        own = by_name.get(sensor.name, by_name.get(sensor.reads))
        if own is None:
            continue
        readings = np.concatenate([part.values[:, column] for part in fitted])
        rms = float(np.sqrt(np.nanmean(np.square(readings))))
        system, sensors[column], names = _calibrate(system, sensor, own, rms)
        parameters |= dict.fromkeys(names, sensor.name)
    return Calibrated(system, with_sensors(episodes, tuple(sensors)), parameters)


def _calibrate(
    system: System, sensor: Sensor, parts: Mapping[str, StatedPart], rms: float
) -> tuple[System, Sensor, list[str]]:
    """Return the system with one sensor's parameters, the sensor, and their names."""
    config, taken = system.config, set(system.names)
    label = re.sub(r"\W", "_", sensor.name, flags=re.ASCII)
    values, spreads = dict(config.parameters), dict(config.parameter_spread)
    units, named = dict(config.units), {}
    for part, (value, spread) in parts.items():
        name = named[part] = take_name(f"{part}_of_{label}", taken)
        unknown = GAIN_SPREAD * abs(value) if part == "gain" else OFFSET_SPREAD * rms
        values[name], spreads[name] = value, unknown if spread is None else spread
    summed = summands(system.without_lets(system.parse(sensor.reads, f"system.let.{sensor.reads}")))
    if "gain" in named:
        # A known part such as -R0*I stays a summand of its own.
        summed = tuple(multiply((Name(named["gain"]), term)) for term in summed)
    if "offset" in named:
        summed = (*summed, Name(named["offset"]))
    reads = take_name(f"{label}_reading", taken)
    if sensor.reads in units:
        units[reads] = units[sensor.reads]
        if "offset" in named:
            units[named["offset"]] = units[sensor.reads]
    changed = replace(
        config,
        parameters=values,
        parameter_spread=spreads,
        let={**config.let, reads: to_text(add(summed))},
        units=units,
    )
    calibrated = replace(sensor, reads=reads, is_calibrated=True)
    return system.with_config(changed), calibrated, [*named.values()]
