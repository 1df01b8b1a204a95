"""What a tracker says about a stream: nothing, a sensor that fails, or physics that changes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import streams


def test_nothing_is_said_about_white_noise() -> None:
    assert not streams.alarms(streams.tracker(), *streams.readings(1500, seed=2))


@pytest.mark.parametrize("sensor", [0, 1])
def test_a_drift_of_three_std_in_100_samples_is_found_within_60(sensor: int) -> None:
    times, values = streams.readings(600, seed=3)
    begins = 400
    values[begins:, sensor] += 0.03 * streams.SIGMA * np.arange(200)
    found = streams.alarms(streams.tracker(), times, values)
    assert found
    assert found[0].time <= times[begins + 60] and found[0].since >= times[begins - 10]
    told = [(each.kind, each.sensors) for each in found]
    assert told == [("begun", (sensor,)), ("sensor", (sensor,))]


def test_a_term_that_is_switched_on_is_found() -> None:
    # Both laws agree until the term begins.
    times, values = streams.readings(800, seed=4, law="-0.3*p*step(t - 50)")
    found = streams.alarms(streams.tracker(), times, values)
    assert found
    assert [each.kind for each in found[:2]] == ["begun", "several"]
    assert times[480] < found[0].since <= found[0].time < times[580]
