"""A first state through the sensors' first values."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.pipeline.init.guessed_system import GuessedAxis
from dashred.pipeline.init.start import start_expression


def value_of(expression: str, **coordinates: float) -> float:
    names = {"pi": np.pi, "cos": np.cos, "sin": np.sin, "x_length": 1.0, "y_length": 1.0}
    return float(eval(expression, {"__builtins__": {}}, names | coordinates))


def test_without_axes_it_is_the_number() -> None:
    assert start_expression((), np.empty((1, 0)), np.array([1.25])) == "1.25"


def test_a_wave_that_many_sensors_read_is_drawn() -> None:
    x = np.linspace(0.2, 9.8, 40)
    axis = GuessedAxis("x", 10.0, 64)
    found = start_expression((axis,), x[:, None], 2 + np.cos(2 * np.pi * x / 10))
    assert value_of(found, x=0.0, x_length=10.0) == pytest.approx(3, abs=0.02)
    assert value_of(found, x=5.0, x_length=10.0) == pytest.approx(1, abs=0.02)


def test_a_few_sensors_draw_no_wilder_a_field_than_they_read() -> None:
    values = np.array([1.0, 1.2, 0.9])
    places = np.array([[0.1, 0.4], [0.2, 0.1], [0.9, 0.8]])
    axes = (GuessedAxis("x", 1.0, 32), GuessedAxis("y", 1.0, 32))
    found = start_expression(axes, places, values)
    field = [value_of(found, x=x, y=y) for x in np.arange(0, 1, 0.1) for y in np.arange(0, 1, 0.1)]
    assert min(field) > 0.5
    assert max(field) < 1.6
