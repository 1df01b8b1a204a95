"""Held and delayed inputs, and inputs with gaps: the curve between samples."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dashred.data.input_action import act, fill_gaps

TIMES = np.array([0.0, 1.0, 2.0, 4.0])
VALUES = np.array([1.0, 3.0, 3.0, -2.0])


def at(moments, hold, delay):
    return np.interp(moments, *act(TIMES, VALUES, hold, delay))


def test_a_held_sample_stays_until_the_next_one():
    np.testing.assert_allclose(at([0, 0.99, 1.01, 2.5, 3.99], True, 0), [1, 1, 3, 3, 3])
    # At its own time a sample has its value.
    np.testing.assert_array_equal(at(TIMES, True, 0), VALUES)


def test_a_delayed_input_acts_later():
    moments = np.linspace(0, 4, 81)
    np.testing.assert_allclose(at(moments, False, 0.5), at(moments - 0.5, False, 0), atol=1e-12)
    away = moments[np.abs(moments * 2 - np.round(moments * 2)) > 0.01]
    np.testing.assert_allclose(at(away, True, 0.5), at(away - 0.5, True, 0))
    knots, _ = act(TIMES, VALUES, True, 0.5)
    assert (knots[0], knots[-1]) == (0, 4) and (np.diff(knots) > 0).all()


def test_without_hold_and_delay_the_samples_are_kept():
    times, values = act(TIMES, VALUES, False, 0.0)
    assert times is TIMES and values is VALUES


@given(
    st.lists(st.floats(-5, 5), min_size=2, max_size=12),
    st.lists(st.floats(0.1, 3), min_size=11, max_size=11),
    st.booleans(),
    st.floats(0, 2),
)
def test_the_curve_keeps_the_time_and_the_range_of_the_samples(values, steps, hold, delay):
    times = np.concatenate([[0.0], np.cumsum(steps)])[: len(values)]
    delay = min(delay, 0.5 * times[-1])
    knots, levels = act(times, np.array(values), hold, delay)
    assert (np.diff(knots) > 0).all()
    assert (knots[0], knots[-1]) == (times[0], times[-1])
    assert min(values) - 1e-9 <= levels.min() and levels.max() <= max(values) + 1e-9


def test_gaps_are_filled():
    values = np.array([np.nan, 1.0, np.nan, 5.0, np.nan])
    times = np.array([0.0, 1.0, 2.0, 5.0, 6.0])
    np.testing.assert_array_equal(fill_gaps(times, values, False), [np.nan, 1, 2, 5, np.nan])
    np.testing.assert_array_equal(fill_gaps(times, values, True), [np.nan, 1, 1, 5, 5])


def test_times_in_seconds_since_1970_have_jumps():
    times = 1.7e9 + np.arange(5.0)
    knots, levels = act(times, np.array([0.0, 1, 0, 1, 0]), True, 0.0)
    assert (np.diff(knots) > 0).all()
    np.testing.assert_array_equal(np.interp(times[:-1] + 0.5, knots, levels), [0, 1, 0, 1])
