"""Time scales of waves with known periods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.data.clocks.time_scale import (
    lost_change,
    round_down,
    samples_per_change,
    step_that_keeps,
    suggested_step,
)
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor


def wave(samples_a_period: float, noise: float) -> Recording:
    rng = np.random.default_rng(1)
    index = np.arange(4000)
    values = np.sin(2 * np.pi * index / samples_a_period) + noise * rng.standard_normal(4000)
    return Recording((Sensor("y", "y"),), np.linspace(0.0, 0.5 * 3999, 4000), values[:, None])


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("period", [160.0, 800.0])
def test_a_sixteenth_of_the_period_is_found_under_noise(period: float, noise: float) -> None:
    lag = samples_per_change(wave(period, noise), np.array([noise]))["y"]
    assert lag == pytest.approx(period / 16, rel=0.1, abs=1)


def test_the_suggested_step_is_round_and_no_coarser() -> None:
    recording, noise = wave(160.0, 0.01), np.array([0.01])
    assert suggested_step(recording, {"y": 10}, noise) == pytest.approx(5.0)
    assert suggested_step(recording, {"y": 9}, noise) == pytest.approx(2.0)
    assert suggested_step(recording, {"y": 1}, noise) is None


@pytest.mark.parametrize("begin", [40, 45, 2000])
def test_a_short_transient_is_not_thinned_away(begin: int) -> None:
    """A switch rings for a few samples in a record of slow waves."""
    recording, noise = wave(160.0, 0.01), np.array([0.01])
    after = np.arange(4000) - begin
    ringing = np.where(after >= 0, np.exp(-np.maximum(after, 0) / 6) * np.cos(after), 0.0)
    values = recording.values + ringing[:, None]
    step = suggested_step(replace(recording, values=values), {"y": 10}, noise)
    assert step is None or step <= 1.0


@pytest.mark.parametrize("sigma", [1e-4, 1e-3])
@pytest.mark.parametrize("share", [0.3, 0.1, 0.03])
@pytest.mark.parametrize("rate", [3.0, 10.0])
def test_a_fast_response_with_a_long_tail_is_not_thinned_away(
    rate: float, share: float, sigma: float
) -> None:
    """A step response at the start: its fast part lasts for few of very many samples."""
    times = np.linspace(0.0, 1999.9, 20_000)
    fast = share * np.exp(-times / rate)
    values = 1 - fast - (1 - share) * np.exp(-times / 400)
    values += sigma * np.random.default_rng(5).standard_normal(len(times))
    recording, noise = Recording((Sensor("y", "y"),), times, values[:, None]), np.array([sigma])
    lags = samples_per_change(recording, noise)
    assert lags["y"] > 1000
    step = suggested_step(recording, lags, noise)
    assert step is not None and step < 2 * rate
    assert lost_change(recording, noise, step) is None
    lost = lost_change(recording, noise, 10 * rate)
    assert lost is not None and lost[0] == "y" and lost[1] < 5 * rate
    shorter = step_that_keeps(recording, noise, 10 * rate)
    assert shorter is not None and lost_change(recording, noise, shorter) is None


def test_times_that_are_dense_at_the_start_are_not_lost_to_a_clock() -> None:
    """As a logger with two rates writes them: 100 Hz at first, then 1 Hz."""
    times = np.concatenate([np.linspace(0.0, 3.99, 400), np.linspace(4.0, 2003.0, 2000)])
    values = 1 - 0.2 * np.exp(-times / 0.05) - 0.8 * np.exp(-times / 300)
    recording, noise = Recording((Sensor("y", "y"),), times, values[:, None]), np.array([1e-3])
    lost = lost_change(recording, noise, 1.0)
    assert lost is not None and lost[1] < 1


def test_a_slow_record_may_be_thinned_to_a_hundred_and_fifty_samples() -> None:
    times = np.linspace(0.0, 1999.9, 20_000)
    values = 1 - np.exp(-times / 400) + 1e-3 * np.random.default_rng(6).standard_normal(20_000)
    recording, noise = Recording((Sensor("y", "y"),), times, values[:, None]), np.array([1e-3])
    assert suggested_step(recording, samples_per_change(recording, noise), noise) == 10


def test_where_nothing_but_noise_is_seen_nothing_is_timed() -> None:
    rng = np.random.default_rng(2)
    values = 0.1 * rng.standard_normal((500, 1))
    assert not samples_per_change(
        Recording((Sensor("y", "y"),), np.arange(500.0), values), np.array([0.1])
    )


@pytest.mark.parametrize(("value", "round_one"), [(0.0625, 0.05), (0.05, 0.05), (199.0, 100.0)])
def test_round_numbers(value: float, round_one: float) -> None:
    assert round_down(value) == pytest.approx(round_one)
