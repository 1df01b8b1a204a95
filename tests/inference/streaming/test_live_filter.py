"""The filter finds the state, and runs as the simulator does."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from dashred.inference.initial_state.ensemble_filter import FilterLostError
from dashred.inference.observer.march import March
from dashred.inference.streaming.live_estimator import LiveSettings
from dashred.inference.streaming.live_filter import LiveFilter
from dashred.physics.solvers.simulate import simulate
from tests.support import streams

NO_LIMITS = np.full(2, np.inf)


def filter_of(climate: np.ndarray) -> LiveFilter:
    noise = np.full(2, streams.SIGMA)
    return LiveFilter(
        March(streams.system()), streams.SENSORS, (), noise, climate, 30, LiveSettings(), seed=0
    )


def test_members_run_as_the_simulator_does() -> None:
    system, states = streams.system(), streams.climate()[:5]
    times = torch.tensor([3.0, 3.37], dtype=torch.float64)
    exact = simulate(system, torch.from_numpy(states), times)[:, -1]
    np.testing.assert_allclose(March(system)(states, 3.0, 0.37), exact.numpy(), rtol=1e-12)


def test_the_state_is_found_within_its_spread() -> None:
    live = filter_of(streams.climate())
    times, values = streams.readings(200, seed=9)
    truth = values - streams.SIGMA * np.random.default_rng(9).standard_normal(values.shape)
    scores = []
    for time, sample, exact in zip(times, values, truth, strict=True):
        found = live.step(float(time), streams.EVERY, sample, NO_LIMITS)
        scores.append((found.estimate - exact) / found.spread)
    late = np.array(scores)[50:]
    assert np.abs(found.estimate - truth[-1]).max() < streams.SIGMA
    assert 0.5 < late.std() < 1.5


def test_a_copy_goes_its_own_way() -> None:
    live = filter_of(streams.climate())
    live.step(0.0, streams.EVERY, np.zeros(2), NO_LIMITS)
    other = live.copy()
    ours = live.step(0.1, streams.EVERY, np.zeros(2), NO_LIMITS)
    theirs = other.step(0.1, streams.EVERY, np.zeros(2), NO_LIMITS)
    np.testing.assert_array_equal(ours.estimate, theirs.estimate)
    live.step(0.2, streams.EVERY, np.ones(2), NO_LIMITS)
    assert not np.array_equal(live.members, other.members)


def test_a_filter_that_is_lost_says_so() -> None:
    live = filter_of(streams.climate())
    live.step(0.0, streams.EVERY, np.zeros(2), NO_LIMITS)
    live.members *= np.inf
    with pytest.raises(FilterLostError):
        live.step(0.1, streams.EVERY, np.zeros(2), NO_LIMITS)


def test_a_few_lost_members_are_replaced() -> None:
    live = filter_of(streams.climate())
    live.step(0.0, streams.EVERY, np.full(2, math.nan), NO_LIMITS)
    live.members[:3] = 1e6
    live.step(0.1, streams.EVERY, np.full(2, math.nan), NO_LIMITS)
    assert np.abs(live.members).max() < 100
