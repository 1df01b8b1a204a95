"""What a tracker says about a stream: nothing, a sensor that fails, or physics that changes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dashred.inference.streaming.live_estimator import LiveEstimator
from tests.support import streams

Estimator = Callable[[], LiveEstimator]
both = pytest.mark.parametrize("estimator", [streams.ensemble_filter, streams.observer])


@both
def test_nothing_is_said_about_white_noise(estimator: Estimator) -> None:
    assert not streams.alarms(streams.tracker(estimator()), *streams.readings(1500, seed=2))


@both
@pytest.mark.parametrize("sensor", [0, 1])
def test_a_drift_of_three_std_in_100_samples_is_found_within_60(
    sensor: int, estimator: Estimator
) -> None:
    times, values = streams.readings(600, seed=3)
    begins = 400
    values[begins:, sensor] += 0.03 * streams.SIGMA * np.arange(200)
    found = streams.alarms(streams.tracker(estimator()), times, values)
    assert found
    assert found[0].time <= times[begins + 60] and found[0].since >= times[begins - 10]
    told = [(each.kind, each.sensors) for each in found]
    assert told == [("begun", (sensor,)), ("sensor", (sensor,))]


@both
def test_a_term_that_is_switched_on_is_found(estimator: Estimator) -> None:
    # Both laws agree until the term begins.
    times, values = streams.readings(800, seed=4, law="-0.3*p*step(t - 50)")
    found = streams.alarms(streams.tracker(estimator()), times, values)
    assert found
    assert [each.kind for each in found[:2]] == ["begun", "several"]
    assert times[480] < found[0].since <= found[0].time < times[580]
