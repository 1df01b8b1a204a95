"""Estimates of sensor noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor


def recording_of(*columns, reads=("u", "u", "v"), stds=(None, None, None)):
    sensors = tuple(Sensor(f"s{i}", reads[i], (), stds[i]) for i in range(len(columns)))
    return Recording(
        sensors, 0.01 * np.arange(len(columns[0]), dtype=np.float64), np.stack(columns, axis=1)
    )


@pytest.fixture
def noisy():
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(2000)
    return np.sin(time) + 0.05 * rng.standard_normal(2000), 3 * time**2 + rng.standard_normal(2000)


def test_white_noise_on_a_smooth_signal_is_found(noisy):
    found = noise_std(recording_of(*noisy))
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, [0.05, 1.0], rtol=0.1)


def test_uneven_steps_are_no_noise():
    rng = np.random.default_rng(8)
    time = np.cumsum(rng.uniform(0.02, 0.18, 2000))
    clean, white = np.sin(time) + time**2 / 1000, rng.standard_normal(2000)
    for sigma in (0.002, 0.1):
        values = clean + sigma * white
        found = noise_std(Recording((Sensor("s", "u"),), time, values[:, None]))
        assert found[0] == pytest.approx(sigma, rel=0.1)


def test_jumps_spikes_and_missing_values_hardly_matter(noisy):
    spoilt = noisy[0].copy()
    spoilt[::40] += 100.0
    spoilt[7::41] = np.nan
    assert noise_std(recording_of(spoilt))[0] == pytest.approx(0.05, rel=0.25)


def test_noise_of_two_loggers_in_one_table(noisy):
    first, second = (column.copy() for column in noisy)
    first[1::2] = second[::2] = np.nan
    found = noise_std(recording_of(first, second))
    np.testing.assert_allclose(found, [0.05, 1.0], rtol=0.1)


def test_a_stated_std_is_taken(noisy):
    found = noise_std(recording_of(*noisy, stds=(0.2, None)))
    assert found[0] == 0.2
    assert found[1] == pytest.approx(1.0, rel=0.1)


def test_a_stuck_sensor_gets_the_noise_of_those_that_read_the_same(noisy):
    found = noise_std(recording_of(noisy[0], np.full(2000, 7.0), noisy[1]))
    assert found[1] == found[0]


def test_noise_is_estimated_from_episodes_in_which_a_sensor_changes(noisy):
    both, flat = recording_of(*noisy), recording_of(np.full(2000, 7.0), noisy[1])
    louder = recording_of(7 * noisy[0], noisy[1])
    one, seven = (noise_std(each)[0] for each in (both, louder))
    found = noise_std(flat, both, louder)
    assert found[0] == pytest.approx(np.sqrt((one**2 + seven**2) / 2))
    assert found[1] == pytest.approx(noise_std(both)[1])


def test_coarse_rounding_still_gives_a_noise(noisy):
    rounded = np.round(noisy[0] / 0.5) * 0.5
    assert 0.01 < noise_std(recording_of(rounded))[0] < 0.5


def test_nothing_to_estimate_from_is_refused(noisy):
    stuck = recording_of(np.full(50, 7.0))
    with pytest.raises(InputError, match="'s0' cannot be estimated"):
        noise_std(stuck)
    stated = replace(stuck, sensors=(replace(stuck.sensors[0], std=0.1),))
    assert noise_std(stated).tolist() == [0.1]
    with pytest.raises(InputError, match="'s2' cannot be estimated"):
        noise_std(recording_of(*noisy, np.full(2000, 1.0)))


def test_a_slow_signal_that_is_rounded_has_the_noise_of_rounding():
    """Of 1000 readings of a thermometer with a step of 0.1, neighbours are nearly always equal."""
    slow = 12.0 + 3.0 * np.linspace(0, 1, 1000)
    found = noise_std(recording_of(np.round(slow, 1)))[0]
    assert found == pytest.approx(0.1 / np.sqrt(12), rel=0.1)
