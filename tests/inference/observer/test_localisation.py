"""Localisation keeps as many sensors about a point as the simulations can support."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dashred.data.sensors import Sensor
from dashred.inference.observer.localisation import radius_for, sensor_tapers, used_sensors
from dashred.physics.system import System
from tests.evaluation.foreign.invented import RING, config_of


def ring() -> System:
    config = config_of(RING)
    return System(config.system, config.where)


def test_enough_simulations_need_no_localisation() -> None:
    assert math.isinf(radius_for(ring(), sensors=12, simulations=96))
    assert used_sensors(12, 96) == used_sensors(12, 500) == 12


@pytest.mark.parametrize(("sensors", "simulations"), [(40, 80), (100, 400)])
def test_so_many_sensors_are_within_twice_the_radius(sensors: int, simulations: int) -> None:
    system = ring()
    radius = radius_for(system, sensors, simulations)
    spread = [Sensor(str(i), "u", (10 * i / sensors,)) for i in range(sensors)]
    tapers = sensor_tapers(system, spread, spread, radius)
    assert tapers.shape == (sensors, sensors + 40)
    near = (tapers[:, :sensors] > 0).sum(axis=1)
    assert (np.abs(near - used_sensors(sensors, simulations)) <= 1).all()
    np.testing.assert_allclose(np.diag(tapers), 1)


def test_without_a_radius_nothing_is_tapered() -> None:
    spread = [Sensor("one", "u", (0.0,)), Sensor("other", "u", (5.0,))]
    assert (sensor_tapers(ring(), spread, spread, math.inf) == 1).all()
