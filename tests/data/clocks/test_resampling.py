"""Resampling of recordings to a uniform clock."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.data.clocks.resampling import native_step, resample, resample_all
from dashred.data.episodes import Episode, Episodes
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor


def recorded(times, values=None):
    times = np.asarray(times, dtype=np.float64)
    values = np.sin(times) if values is None else values
    return Recording((Sensor("a", "u"),), times, np.asarray(values, dtype=np.float64)[:, None])


def test_a_uniform_recording_stays_as_it_is():
    recording = recorded(5.0 + 0.1 * np.arange(50))
    for every in (None, 0.1):
        same, says = resample(recording, every)
        np.testing.assert_allclose(same.times, recording.times, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(same.values, recording.values)
        assert says.startswith("kept samples: 50 at a step of 0.1")


def test_an_oversampled_recording_is_decimated():
    recording = recorded(np.round(0.001 * np.arange(5001), 3))
    thinned, says = resample(recording, 0.01)
    assert thinned.times.shape == (501,)
    np.testing.assert_array_equal(thinned.values, recording.values[::10])
    assert "took one sample of every 10:" in says


def test_a_step_that_is_no_multiple_is_interpolated():
    thinned, says = resample(recorded(0.01 * np.arange(1001)), 0.025)
    np.testing.assert_allclose(np.diff(thinned.times), 0.025)
    np.testing.assert_allclose(thinned.values[:, 0], np.sin(thinned.times), atol=2e-5)
    assert "interpolated" in says


def test_jittered_times_are_interpolated_not_snapped():
    times = 0.01 * np.arange(1001)
    times[1:-1] += np.random.default_rng(0).uniform(-0.003, 0.003, 999)
    thinned, _ = resample(recorded(times), 0.1)
    np.testing.assert_allclose(thinned.values[:, 0], np.sin(thinned.times), atol=5e-5)


@pytest.mark.parametrize(("per", "error"), [(8, 6e-3), (16, 5e-4), (32, 4e-5)])
def test_what_lies_between_uneven_times_errs_with_the_fourth_power_of_the_step(per, error):
    """Linear interpolation would have errors of 0.04, 0.009 and 0.002."""
    times = np.arange(400.0) / per
    times[1:-1] += np.random.default_rng(0).uniform(-0.3, 0.3, 398) / per
    sampled, _ = resample(recorded(times, np.cos(2 * np.pi * times)), 1.2 / per)
    missed = sampled.values[:, 0] - np.cos(2 * np.pi * sampled.times)
    assert np.sqrt(np.mean(missed**2)) < error


def test_two_samples_at_nearly_one_time_do_not_make_noise_steep():
    times = np.sort(np.r_[0.1 * np.arange(200), 0.1 * np.arange(50, 80) + 1e-6])
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(times))
    sampled, _ = resample(recorded(times, np.sin(times) + noise), 0.17)
    assert np.nanmax(np.abs(sampled.values[:, 0] - np.sin(sampled.times))) < 0.05


def test_noise_at_uneven_ends_stays_what_it_is():
    noise, worst = np.random.default_rng(3), 0.0
    for _ in range(200):
        times = np.cumsum(np.r_[0.0, 2.0, 0.3, 0.3, np.ones(40), 0.3, 0.3, 2.0])
        read = noise.standard_normal(len(times))
        sampled, _ = resample(recorded(times, read), 1.01)
        worst = max(worst, np.nanmax(np.abs(sampled.values[[1, -2], 0])) / np.abs(read).max())
    assert worst <= 2


def test_lost_rows_and_missing_cells_stay_missing_when_decimated():
    times = 0.1 * np.arange(100)
    values = np.sin(times)
    values[40] = np.nan
    kept = np.r_[0:60, 70:100]
    same, says = resample(recorded(times[kept], values[kept]), None)
    assert np.flatnonzero(np.isnan(same.values[:, 0])).tolist() == [40, *range(60, 70)]
    np.testing.assert_allclose(same.times, times)
    assert "11.0% of the values missing" in says


def test_short_gaps_are_bridged_and_long_ones_are_not():
    times = 0.1 * np.arange(200)
    values = np.sin(times)
    values[50] = np.nan
    values[100:103] = np.nan
    bridged, _ = resample(recorded(times, values), 0.15)
    missing = bridged.times[np.isnan(bridged.values[:, 0])]
    np.testing.assert_allclose(missing, [10.05, 10.2])
    present = ~np.isnan(bridged.values[:, 0])
    truth = np.sin(bridged.times[present])
    np.testing.assert_allclose(bridged.values[present, 0], truth, atol=0.006)


def test_a_lone_sample_between_gaps_is_kept():
    times = 0.1 * np.arange(200)
    values = np.sin(times)
    values[100:105] = values[106:111] = np.nan
    lone, _ = resample(recorded(times, values), 0.15)
    present = lone.times[~np.isnan(lone.values[:, 0])]
    np.testing.assert_allclose(present[(present > 9.95) & (present < 11.05)], [10.5])


def test_values_are_not_invented_before_the_first_or_after_the_last():
    times = 0.1 * np.arange(100)
    values = np.sin(times)
    values[:20] = values[80:] = np.nan
    cut, _ = resample(recorded(times, values), 0.15)
    present = cut.times[~np.isnan(cut.values[:, 0])]
    assert present[0] == pytest.approx(2.1)
    assert present[-1] == pytest.approx(7.8)


def test_the_own_step_ignores_gaps_and_averages_rounding():
    assert native_step(np.r_[0:1:0.1, 5:6:0.1]) == pytest.approx(0.1)
    assert native_step(np.round(np.arange(301) / 300, 3)) == pytest.approx(1 / 300, rel=1e-3)


@pytest.mark.parametrize(
    ("every", "message"), [(0.05, "shorter than the recording's own"), (2.0, "leaves 5 samples")]
)
def test_a_step_that_cannot_serve_is_refused(every, message):
    with pytest.raises(InputError, match=message):
        resample(recorded(0.1 * np.arange(100)), every)


def test_a_step_beyond_all_numbers_is_refused():
    times = np.r_[0.1 * np.arange(12), 1e9]
    with pytest.raises(InputError):
        resample_all(Episodes((Episode("", recorded(times)),)), 1e-300)


def two_loggers(late: float, step: float = 0.1, other: float = 0.1, count: int = 60) -> Recording:
    """Return u at 0, 0.1, … and v a little later, in separate rows."""
    first, second = step * np.arange(count), late + other * np.arange(count)
    times = np.concatenate([first, second])
    values = np.full((2 * count, 2), np.nan)
    values[:count, 0], values[count:, 1] = np.sin(first), np.cos(second)
    order = np.argsort(times)
    return Recording((Sensor("a", "u"), Sensor("b", "v")), times[order], values[order])


@pytest.mark.parametrize(
    "recording",
    [two_loggers(0.003), two_loggers(0.003, count=61), two_loggers(0.013, other=0.1003)],
    ids=["late", "late, odd", "drifting"],
)
def test_the_offset_between_two_clocks_is_no_step(recording):
    sampled, says = resample(recording, None)
    assert "interpolated" in says
    np.testing.assert_allclose(np.diff(sampled.times), 0.1, rtol=5e-3)
    both = Episodes((Episode("", recording), Episode("b", recording)))
    for episode in resample_all(both, None)[0].episodes:
        np.testing.assert_array_equal(episode.recording.times, sampled.times)
    assert np.isnan(sampled.values).mean() < 0.05
    known = ~np.isnan(sampled.values[:, 1])
    truth = np.cos(sampled.times[known])
    np.testing.assert_allclose(sampled.values[known, 1], truth, atol=2e-3)


def test_bursts_of_the_same_sensors_have_an_intermediate_step():
    times = np.sort(np.concatenate([0.1 * np.arange(60), 0.003 + 0.1 * np.arange(60)]))
    sampled, _ = resample(recorded(times), None)
    assert 0.04 < np.diff(sampled.times).mean() < 0.06
    assert not np.isnan(sampled.values).any()


@pytest.mark.parametrize("seed", range(4))
def test_random_times_are_interpolated(seed):
    times = np.cumsum(np.random.default_rng(seed).exponential(0.25, size=240))
    sampled, says = resample(recorded(times), None)
    assert says.startswith("interpolated")
    assert np.isnan(sampled.values).mean() < 0.5


def test_a_long_gap_or_loggers_by_turns_do_not_make_a_clock_empty():
    times = np.concatenate([0.1 * np.arange(60), 100 + 0.1 * np.arange(60)])
    assert resample(recorded(times), None)[0].times.shape == (1060,)
    turns = two_loggers(0.05)
    sampled, says = resample(turns, None)
    assert says.startswith("kept samples: 120 at a step of 0.05")
    np.testing.assert_array_equal(sampled.values, turns.values)


def test_lone_values_move_to_the_nearest_time_of_the_clock():
    """Two sensors that are read at times that grow by a factor, as in a pumping test."""
    times = np.unique(np.concatenate([1.31 ** np.arange(1, 18), 1.47 ** np.arange(1, 13)]))
    values = np.stack([np.log(times), np.sqrt(times)], axis=1)
    values[~np.isin(times, 1.31 ** np.arange(1, 18)), 0] = np.nan
    values[~np.isin(times, 1.47 ** np.arange(1, 13)), 1] = np.nan
    sensors = Sensor("a", "u", (0.5,)), Sensor("b", "u", (1.5,))
    recording = Recording(sensors, times, values)
    own = native_step(times)
    sampled, _ = resample(recording, own)
    known = ~np.isnan(sampled.values)
    # Values that are near each other are interpolated.
    assert (known.sum(axis=0) >= [14, 10]).all()
    exact = np.stack([np.log(sampled.times), np.sqrt(sampled.times)], axis=1)
    slopes = np.stack([1 / sampled.times, 0.5 / np.sqrt(sampled.times)], axis=1)
    assert (np.abs(sampled.values - exact)[known] <= 0.51 * own * slopes[known]).all()
