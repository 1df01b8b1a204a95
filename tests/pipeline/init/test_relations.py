"""Which column is another's rate of change, under noise and at any sampling."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.pipeline.init.relations import accelerations, find_rates


def recording(noise: float, step: float, **columns: np.ndarray) -> Recording:
    rng = np.random.default_rng(0)
    count = len(next(iter(columns.values())))
    values = np.stack(list(columns.values()), axis=1)
    values = values + noise * rng.standard_normal(values.shape)
    sensors = tuple(Sensor(name, name) for name in columns)
    return Recording(sensors, np.linspace(0.0, step * (count - 1), count), values)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_sine_s_rate_is_found_and_nothing_else(noise: float) -> None:
    t = 0.02 * np.arange(2000)
    found = find_rates(recording(noise, 0.02, y=np.sin(t), v=np.cos(t), w=np.sin(3 * t)))
    assert {name: rate.rate for name, rate in found.items()} == {"y": "v"}


def test_twice_the_rate_is_not_the_rate() -> None:
    t = 0.02 * np.arange(2000)
    assert not find_rates(recording(0.0, 0.02, y=np.sin(t), v=2 * np.cos(t)))


def test_the_rate_of_a_rate_is_an_acceleration() -> None:
    t = 0.02 * np.arange(2000)
    moved = {"x": np.sin(t) + 0.1 * t**2, "v": np.cos(t) + 0.2 * t, "a": 0.2 - np.sin(t)}
    assert accelerations(find_rates(recording(0.0, 0.02, **moved))) == ("a",)
    assert accelerations(find_rates(recording(0.0, 0.02, y=np.sin(t), v=np.cos(t)))) == ()
    # Of a sine, the acceleration is minus the place, and no column of its own.
    swing = {"x": np.sin(t), "v": np.cos(t), "minus": -np.sin(t)}
    assert accelerations(find_rates(recording(0.0, 0.02, **swing))) == ("minus",)
