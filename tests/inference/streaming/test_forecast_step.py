"""Forecasts take longer time steps where that changes them far less than the noise does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from dashred.data.sensors import Sensor
from dashred.inference.observer.march import March
from dashred.inference.observer.perturbation_march import STEPS
from dashred.inference.streaming.forecast_step import FIELD_SHARE, with_longest_step
from dashred.inference.streaming.live_estimator import LiveSettings
from dashred.inference.streaming.live_observer import LiveObserver
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
    begin = np.random.default_rng(0).standard_normal((16, POINTS))
    return march(begin - begin.mean(axis=1, keepdims=True), 0.0, 100.0)


def chosen(march: March, states: Array, sigma: float, tolerance: float) -> March:
    readout, noise = Readout(march, march.system, SENSORS), np.full(2, sigma)
    return with_longest_step(march, readout, noise, states, SPAN, AHEAD, tolerance)


def change(flow: March, march: March, states: Array) -> Array:
    difference: Array = flow(states, 0.0, AHEAD) - march(states, 0.0, AHEAD)
    return difference


def sizes(changed: Array, march: March) -> tuple[float, float]:
    """Return the root mean square of the worst reading, and of the field."""
    readings = Readout(march, march.system, SENSORS)(changed, 0.0)
    worst = np.sqrt(np.square(readings).mean(axis=0)).max()
    return float(worst), float(np.sqrt(np.square(changed).mean()))


def test_a_forecast_changes_by_less_than_the_tolerance(march: March, states: Array) -> None:
    sigma, tolerance = 0.002, 0.05
    flow = chosen(march, states[::2], sigma, tolerance)
    count = round(SPAN / flow.system.dt)
    assert 1 < count < SPAN / DT
    # On other states, too, up to chance.
    of_readings, of_field = sizes(change(flow, march, states[1::2]), march)
    assert 0 < of_readings < 1.5 * tolerance * sigma
    assert 0 < of_field < 1.5 * FIELD_SHARE * tolerance * states.std()
    # The next longer step that is tried changes it by more.
    longer = march.with_step(SPAN / max(n for n in STEPS if n < count))
    of_readings, of_field = sizes(change(longer, march, states[::2]), march)
    limit = FIELD_SHARE * tolerance * states.std()
    assert of_readings > tolerance * sigma or of_field > 0.9 * limit


def test_without_a_tolerance_the_step_is_that_of_the_simulator(march: March, states: Array) -> None:
    assert chosen(march, states, 0.05, 0.0) is march


def test_fields_between_the_sensors_count(march: March, states: Array) -> None:
    """Noise that hides every change of a reading does not make the forecast of a field worse."""
    flow = chosen(march, states, math.inf, 0.05)
    _, rms = sizes(change(flow, march, states), march)
    assert 0 < rms <= 1.5 * FIELD_SHARE * 0.05 * states.std()


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


def test_simulators_that_depend_on_time_keep_the_step(
    march: March, states: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(march.system), "reads_time", lambda self: True)
    assert chosen(march, states, 0.05, 0.05) is march


@pytest.fixture(scope="module")
def live(march: March, states: Array) -> LiveObserver:
    """An observer that has assimilated some readings of a state."""
    noise = np.full(2, 0.05)
    observer = LiveObserver(march, SENSORS, (), noise, states, SPAN, LiveSettings(), 0)
    truth = states[:1]
    for sample in range(20):
        readings = observer.quantities(truth, 0.0)[0]
        observer.step(sample * SPAN, SPAN, readings, np.full(2, math.inf))
        truth = march(truth, 0.0, SPAN)
    return observer


def taken(monkeypatch: pytest.MonkeyPatch, fails: float = math.inf) -> list[float]:
    """Return a list of the time steps that are taken from now on; longer ones may blow up."""
    steps, own = [], March.__call__

    def recorded(self: March, states: Array, *rest: float | None) -> Array:
        steps.append(self.system.dt)
        failed = self.system.dt > fails
        return np.full_like(states, np.nan) if failed else own(self, states, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(March, "__call__", recorded)
    return steps


@pytest.mark.parametrize("span", [SPAN, AHEAD])
def test_an_observer_takes_longer_steps(
    live: LiveObserver, span: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = live.march(live.estimate.state, 0.0, span)
    exact = live.quantities(expected, 0.0)[0]
    live.copy().ahead(span)
    # The steps for a span are chosen once, also for copies.
    steps = taken(monkeypatch)
    found = live.copy().ahead(span)
    assert 1 <= len(steps) <= 2 and min(steps) > 1.5 * DT
    np.testing.assert_allclose(found, exact, atol=3 * 0.05 * 0.05)


@pytest.mark.parametrize("span", [SPAN, AHEAD])
def test_a_forecast_that_blows_up_is_repeated_with_the_steps_of_the_simulator(
    live: LiveObserver, span: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = live.quantities(live.march(live.estimate.state, 0.0, span), 0.0)[0]
    live.ahead(span)
    taken(monkeypatch, fails=1.5 * DT)
    np.testing.assert_allclose(live.copy().ahead(span), exact, rtol=1e-9)
