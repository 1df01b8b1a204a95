"""Errors of sensors, and which sensors may err."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.evaluation.foreign.cases.case import Sensor
from dashred.evaluation.foreign.cases.fitted_sensors import fitted_sensors
from dashred.evaluation.foreign.cases.sensor_errors import SHAPES, SIZES, draw_error

TIMES = np.linspace(3.0, 9.0, 120)


def test_every_shape_is_drawn_in_the_stated_size() -> None:
    drawn = [draw_error(TIMES, 0.1, np.random.default_rng(i)) for i in range(60)]
    assert {says for says, _ in drawn} == set(SHAPES)
    sizes = np.array([np.abs(error).max() for _, error in drawn]) / 0.1
    assert sizes.min() >= SIZES[0] - 1e-9 and sizes.max() <= SIZES[1] + 1e-9
    assert {np.sign(error[np.abs(error).argmax()]) for _, error in drawn} == {-1.0, 1.0}


@pytest.mark.parametrize("says", SHAPES)
def test_no_shape_is_a_constant_or_a_straight_line(says: str) -> None:
    curve = SHAPES[says](np.linspace(0, 1, 120), np.random.default_rng(4))
    line = np.polyval(np.polyfit(TIMES, curve, 1), TIMES)
    assert np.std(curve - line) > 0.15 * np.abs(curve).max()


def test_the_fitted_sensors_are_those_of_the_default_splits() -> None:
    sensors = [Sensor(f"s{i}", "u", (float(i),)) for i in range(12)]
    fitted = fitted_sensors(sensors, TIMES, seed=3)
    assert len(fitted) == 7  # of 12, two validate and three test
    assert fitted == fitted_sensors(sensors, TIMES, seed=3)
    few = [Sensor(name, name) for name in "xv"]
    assert fitted_sensors(few, TIMES, seed=3) == [0, 1]
