"""The observer finds the state of a stream, says how well, and uses what it may use."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dashred.data.sensors import Sensor
from dashred.inference.initial_state.ensemble_filter import FilterLostError
from dashred.inference.observer import both_gains
from dashred.inference.observer.estimate import PERTURBATIONS
from dashred.inference.observer.march import March
from dashred.inference.streaming.live_estimator import LiveSettings
from dashred.inference.streaming.live_observer import LiveObserver
from tests.inference.observer.test_both_gains import EVERY, SIGMA, lorenz, lorenz_record
from tests.support import streams

NO_LIMITS = np.full(2, np.inf)
PLACE = Sensor("again", "x")


def observer(additive: float = 1e-3) -> LiveObserver:
    settings, noise = LiveSettings(additive=additive), np.full(2, streams.SIGMA)
    climate = streams.climate()
    return LiveObserver(
        March(streams.system()),
        streams.SENSORS,
        (PLACE,),
        noise,
        climate,
        streams.EVERY,
        settings,
        0,
    )


def follow(live: LiveObserver, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return errors of all quantities in their spreads, and serial innovations, by sample."""
    times, values = streams.readings(samples, seed)
    truth = values - streams.SIGMA * np.random.default_rng(seed).standard_normal(values.shape)
    scores, serials = [], []
    for time, sample, exact in zip(times, values, truth, strict=True):
        found = live.step(float(time), streams.EVERY, sample, NO_LIMITS)
        scores.append((found.estimate - [*exact, exact[0]]) / found.spread)
        serials.append(found.serial)
    return np.array(scores), np.array(serials)


def test_the_state_is_found_within_its_spread() -> None:
    scores, _ = follow(observer(), 600, seed=9)
    late = scores[50:]
    assert 0.4 < late.std() < 1.6
    np.testing.assert_allclose(scores[:, 0], scores[:, 2], rtol=1e-12)


def test_innovations_given_the_earlier_ones_are_independent_and_of_unit_variance() -> None:
    _, serials = follow(observer(), 1500, seed=10)
    late = serials[50:]
    np.testing.assert_allclose(late.std(axis=0), 1, atol=0.1)
    assert abs(np.corrcoef(late.T)[0, 1]) < 0.1
    lagged = np.corrcoef(late[1:, 0], late[:-1, 0])[0, 1]
    assert abs(lagged) < 0.15


def test_a_missing_reading_is_not_used_and_widens_the_spread() -> None:
    live, other = observer(), observer()
    for known in (live, other):
        follow(known, 60, seed=9)
    both = live.step(6.0, streams.EVERY, np.zeros(2), NO_LIMITS)
    one = other.step(6.0, streams.EVERY, np.array([0.0, math.nan]), NO_LIMITS)
    assert (one.spread > both.spread).all()
    assert np.isnan(one.innovation[1]) and np.isnan(one.serial[1])
    assert both.serial[0] == pytest.approx(one.serial[0])


def test_a_reading_above_its_limit_is_not_used() -> None:
    live = observer()
    follow(live, 60, seed=9)
    before = live.copy()
    far = np.array([50.0, 0.0])
    told = live.step(6.0, streams.EVERY, far, np.array([6.0, 0.0]))
    nothing = before.step(6.0, streams.EVERY, np.full(2, math.nan), NO_LIMITS)
    np.testing.assert_array_equal(told.estimate, nothing.estimate)
    assert told.innovation[0] > 40 and np.isnan(told.serial).all() and told.density == 0


def test_a_copy_goes_its_own_way_and_a_new_beginning_forgets() -> None:
    live = observer()
    first = live.step(0.0, streams.EVERY, np.zeros(2), NO_LIMITS)
    other = live.copy()
    ours = live.step(0.1, streams.EVERY, np.zeros(2), NO_LIMITS)
    theirs = other.step(0.1, streams.EVERY, np.zeros(2), NO_LIMITS)
    np.testing.assert_array_equal(ours.estimate, theirs.estimate)
    live.step(0.2, streams.EVERY, np.ones(2), NO_LIMITS)
    assert not np.array_equal(live.mean, other.mean)
    live.begin()
    again = live.step(0.0, streams.EVERY, np.zeros(2), NO_LIMITS)
    np.testing.assert_array_equal(first.estimate, again.estimate)


def test_a_forecast_does_not_change_what_follows() -> None:
    live, other = observer(), observer()
    for known in (live, other):
        follow(known, 30, seed=9)
    forecast = live.ahead(streams.EVERY)
    live.ahead(5 * streams.EVERY)
    np.testing.assert_array_equal(forecast, live.ahead(streams.EVERY))
    ours, theirs = (
        each.step(3.0, streams.EVERY, np.full(2, math.nan), NO_LIMITS) for each in (live, other)
    )
    np.testing.assert_array_equal(ours.estimate, theirs.estimate)
    np.testing.assert_array_equal(ours.estimate, forecast)


def test_a_larger_error_of_the_simulator_makes_it_less_certain() -> None:
    settled = []
    for additive in (1e-3, 1e-1):
        live = observer(additive)
        follow(live, 100, seed=9)
        settled.append(live.step(10.0, streams.EVERY, np.zeros(2), NO_LIMITS).spread)
    assert (settled[1] > 2 * settled[0]).all()
    assert observer().with_settings(LiveSettings(additive=1e-1)).settings.additive == 1e-1


def test_an_estimate_that_blows_up_says_so() -> None:
    live = observer()
    live.step(0.0, streams.EVERY, np.zeros(2), NO_LIMITS)
    live.estimate.state = live.estimate.state * np.inf
    with pytest.raises(FilterLostError, match="blown up"):
        live.step(0.1, streams.EVERY, np.zeros(2), NO_LIMITS)


def lorenz_errors() -> tuple[LiveObserver, np.ndarray, np.ndarray]:
    """Return an observer after a stream of x, and errors and spreads of x and y by sample."""
    given, truth = lorenz_record(seed=5)
    climate = np.concatenate([given.states(sample) for sample in (20, 60)])
    live = LiveObserver(
        March(lorenz()),
        (Sensor("x", "x"),),
        (Sensor("y", "y"),),
        np.array([SIGMA]),
        climate,
        EVERY,
        LiveSettings(),
        0,
    )
    errors, spreads = [], []
    for time, sample, exact in zip(given.times, given.values, truth, strict=True):
        found = live.step(float(time), EVERY, sample, NO_LIMITS[:1])
        live.ahead(EVERY)
        errors.append(found.estimate - exact[:2])
        spreads.append(found.spread)
    return live, np.array(errors)[20:], np.array(spreads)[20:]


def test_in_a_chaotic_system_perturbations_follow_the_state(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    live, errors, spreads = lorenz_errors()
    assert len(live.estimate.perturbations) == PERTURBATIONS
    assert f"{PERTURBATIONS} perturbations" in live.description
    assert 0.4 < (errors / spreads).std() < 1.6
    other = live.copy()
    live.step(8.0, EVERY, np.zeros(1), NO_LIMITS[:1])
    assert not np.array_equal(live.estimate.perturbations, other.estimate.perturbations)
    monkeypatch.setattr(both_gains, "MARGIN", np.inf)
    fixed, others, _ = lorenz_errors()
    assert not len(fixed.estimate.perturbations) and "perturbations" not in fixed.description
    assert np.square(errors).mean() < np.square(others).mean()
