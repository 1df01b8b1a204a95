"""The noise of sensors as the user states it: in units, as a share, or by the reading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dashred.core.stated.noise import NoiseLaw, parse_noise
from dashred.data.episodes import Episodes, fitted_parts, with_sensors
from dashred.data.sensors import Sensor, check_named_sensors
from dashred.data.stated.relative_noise import Array, noise_at

# A noise that is a share of the reading is at least this share of its size at the rms reading.
LEAST_SHARE = 0.01


def with_noise_of_sensors(episodes: Episodes, stated: Any, where: str) -> Episodes:
    """Return a recording with the noise that the configuration states.

    Args:
        episodes: the recording.
        stated: ``recording.std``: None, one noise for all sensors, or the noise of some by the name
            of the sensor or of what it reads.
        where: location of the key.

    Raises:
        InputError: a name is neither that of a sensor nor of what one reads, or a noise is invalid.
    """
    if stated is None:
        return episodes
    if isinstance(stated, Mapping):
        check_named_sensors(episodes.sensors, stated, "recording.std", where)
    sensors = tuple(_stated(sensor, stated, where) for sensor in episodes.sensors)
    return with_sensors(episodes, sensors)


def resolve_shares(episodes: Episodes, fitted: int, held_out: float) -> Episodes:
    """Return a recording in which every stated noise has a std in units.

    The std of a noise that depends on the reading is its rms. The std of the readings is the rms
    over the fitted episodes in which the sensor changes, each without its held-out end.

    Args:
        episodes: the recording.
        fitted: number of episodes, from the first, that are not held out as a whole.
        held_out: share of each episode, at its end, that is held out.
    """
    if all(s.std_share is None and s.noise_law is None for s in episodes.sensors):
        return episodes
    parts = fitted_parts(episodes, fitted, held_out)
    stds = [part.trace_std() for part in parts]
    changing = np.maximum((np.array(stds) > 0).sum(axis=0), 1)
    size = np.sqrt(np.square(stds).sum(axis=0) / changing)
    sensors = []
    for column, (sensor, std) in enumerate(zip(episodes.sensors, size.tolist(), strict=True)):
        if sensor.noise_law is not None:
            readings = np.concatenate([part.values[:, column] for part in parts])
            sensors.append(_with_rms_noise(sensor, sensor.noise_law, readings))
            continue
        # A sensor that stays constant has no scale: its noise counts as unknown.
        own = sensor.std if sensor.std_share is None else sensor.std_share * std or None
        sensors.append(replace(sensor, std=own, std_share=None))
    return with_sensors(episodes, tuple(sensors))


def _with_rms_noise(sensor: Sensor, law: NoiseLaw, readings: Array) -> Sensor:
    """Return a sensor with the rms of a noise that depends on the reading."""
    rms = float(np.sqrt(np.nanmean(np.square(readings))))
    # Near zero a share of the reading would have any weight.
    floor = max(law.constant, LEAST_SHARE * law.relative * rms)
    found = law._replace(constant=floor)
    std = float(np.sqrt(np.nanmean(np.square(noise_at(found, readings)))))
    return replace(sensor, std=std or None, noise_law=found if std else None)


def _stated(sensor: Sensor, stated: Any, where: str) -> Sensor:
    given = stated
    if isinstance(stated, Mapping):
        given = stated.get(sensor.name, stated.get(sensor.reads))
        if given is None:
            return sensor
    std, share, law = parse_noise(given, "recording.std", where)
    return replace(sensor, std=std, std_share=share, noise_law=law)
