"""Time scales of waves with known periods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.data.clocks.time_scale import round_down, samples_per_change, suggested_step
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


def test_where_nothing_but_noise_is_seen_nothing_is_timed() -> None:
    rng = np.random.default_rng(2)
    values = 0.1 * rng.standard_normal((500, 1))
    assert not samples_per_change(
        Recording((Sensor("y", "y"),), np.arange(500.0), values), np.array([0.1])
    )


@pytest.mark.parametrize(("value", "round_one"), [(0.0625, 0.05), (0.05, 0.05), (199.0, 100.0)])
def test_round_numbers(value: float, round_one: float) -> None:
    assert round_down(value) == pytest.approx(round_one)
