"""Forecasts take longer time steps where that changes them far less than the noise does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from dashred.data.sensors import Sensor
from dashred.inference.observer.march import March
from dashred.inference.streaming.forecast_step import FIELD_SHARE, with_longest_step
from dashred.inference.streaming.readout import Readout
from tests.inference.observer.test_perturbation_march import (
    DT,
    POINTS,
    SHORT,
    SPAN,
    kuramoto_sivashinsky,
    wave_equation,
)

Array = NDArray[np.float64]
SENSORS = (Sensor("one", "u", (3.0,)), Sensor("other", "u", (5.0,)))
AHEAD = 4 * SPAN


@pytest.fixture(scope="module")
def march() -> March:
    return March(kuramoto_sivashinsky())


@pytest.fixture(scope="module")
def states(march: March) -> Array:
    """States of the attractor."""
    begin = np.random.default_rng(0).standard_normal((12, POINTS))
    return march(begin - begin.mean(axis=1, keepdims=True), 0.0, 100.0)


def chosen(march: March, states: Array, sigma: float, tolerance: float) -> March:
    readout, noise = Readout(march, march.system, SENSORS), np.full(2, sigma)
    return with_longest_step(march, readout, noise, states, SPAN, AHEAD, tolerance)


def change(flow: March, march: March, states: Array) -> Array:
    difference: Array = flow(states, 0.0, AHEAD) - march(states, 0.0, AHEAD)
    return difference


def test_a_forecast_changes_by_less_than_the_tolerance(march: March, states: Array) -> None:
    sigma, tolerance = 0.002, 0.05
    flow = chosen(march, states, sigma, tolerance)
    assert flow.system.dt > 1.5 * DT
    changed = change(flow, march, states[:8])
    rms = np.sqrt(np.square(Readout(march, march.system, SENSORS)(changed, 0.0)).mean(axis=0))
    assert (rms <= tolerance * sigma).all() and rms.max() > 0
    # The next longer step changes it by more.
    longer = march.with_step(SPAN / (round(SPAN / flow.system.dt) - 1))
    more = change(longer, march, states[:8])
    of_readings = Readout(march, march.system, SENSORS)(more, 0.0)
    too_far = np.sqrt(np.square(of_readings).mean(axis=0)).max() > tolerance * sigma
    of_field = np.sqrt(np.square(more).mean()) > FIELD_SHARE * tolerance * states.std()
    assert too_far or of_field


def test_without_a_tolerance_the_step_is_that_of_the_simulator(march: March, states: Array) -> None:
    assert chosen(march, states, 0.05, 0.0) is march


def test_fields_between_the_sensors_count(march: March, states: Array) -> None:
    """Noise that hides every change of a reading does not make the forecast of a field worse."""
    flow = chosen(march, states, math.inf, 0.05)
    size = np.sqrt(np.square(states - states.mean(axis=0)).mean())
    rms = np.sqrt(np.square(change(flow, march, states[:8])).mean())
    assert 0 < rms <= FIELD_SHARE * 0.05 * size


def test_steps_that_amplify_short_waves_are_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    waves, x = March(wave_equation()), 2 * np.pi * np.arange(SHORT) / SHORT
    amplitudes = np.random.default_rng(0).standard_normal((16, 2, 2))
    states = (amplitudes @ np.stack([np.sin(x), np.cos(x)])).reshape(16, -1)
    readout, noise = Readout(waves, waves.system, SENSORS), np.full(2, 1.0)
    known = waves, readout, noise, states, SPAN, SPAN, 0.5
    assert with_longest_step(*known).system.dt < SPAN
    monkeypatch.setattr("dashred.inference.observer.perturbation_march.is_stable", lambda *_: True)
    assert with_longest_step(*known).system.dt == SPAN


def test_inputs_that_come_in_keep_the_step(
    march: March, states: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(March, "has_inputs", True)
    assert chosen(march, states, 0.05, 0.05) is march
