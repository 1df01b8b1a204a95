"""Bringing recordings to a uniform clock."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.errors import InputError
from dashred.sensing.clock import own_step, resample
from dashred.sensing.recording import Recording
from dashred.sensing.sensors import Sensor


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
    assert "every 10. sample" in says


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
    assert own_step(np.r_[0:1:0.1, 5:6:0.1]) == pytest.approx(0.1)
    assert own_step(np.round(np.arange(301) / 300, 3)) == pytest.approx(1 / 300, rel=1e-3)


@pytest.mark.parametrize(
    ("every", "message"), [(0.05, "shorter than the recording's own"), (1.0, "leaves 10 samples")]
)
def test_a_step_that_cannot_serve_is_refused(every, message):
    with pytest.raises(InputError, match=message):
        resample(recorded(0.1 * np.arange(100)), every)
