"""Lagged windows and filled gaps."""

from __future__ import annotations

import pytest
import torch

from dashred.core.errors import InputError
from dashred.models.lag_windows import fill_missing, windows

NAN = float("nan")


def test_a_window_ends_at_its_own_time_and_repeats_the_first_sample():
    traces = torch.tensor([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0], [4.0, 40.0]])
    seen = windows(traces, 2)
    assert seen.shape == (4, 3, 2)
    assert seen[..., 0].tolist() == [[1, 1, 1], [1, 1, 2], [1, 2, 3], [2, 3, 4]]
    assert seen[..., 1].tolist() == [[10, 10, 10], [10, 10, 20], [10, 20, 30], [20, 30, 40]]


def test_batches_are_kept_apart_and_no_lags_change_nothing():
    traces = torch.randn(2, 5, 7, 3)
    seen = windows(traces, 4)
    assert seen.shape == (2, 5, 7, 5, 3)
    torch.testing.assert_close(seen[1, 2], windows(traces[1, 2], 4))
    torch.testing.assert_close(windows(traces, 0)[..., 0, :], traces)


def test_more_lags_than_samples_are_possible():
    assert windows(torch.tensor([[1.0], [2.0]]), 3).tolist() == [
        [[1.0], [1.0], [1.0], [1.0]],
        [[1.0], [1.0], [1.0], [2.0]],
    ]


def test_gaps_are_filled_linearly_and_ends_by_the_nearest():
    traces = torch.tensor([[NAN, 5.0], [2.0, NAN], [NAN, NAN], [4.0, 8.0], [NAN, 9.0]])
    filled = fill_missing(traces)
    assert filled[:, 0].tolist() == [2.0, 2.0, 3.0, 4.0, 4.0]
    assert filled[:, 1].tolist() == [5.0, 6.0, 7.0, 8.0, 9.0]
    assert traces.isnan().sum() == 5
    torch.testing.assert_close(windows(traces, 1), windows(filled, 1))


def test_filling_keeps_batches_and_dtype():
    traces = torch.randn(3, 6, 2, dtype=torch.float64)
    holed = traces.clone()
    holed[1, 2, 0] = NAN
    filled = fill_missing(holed)
    assert filled.dtype is torch.float64
    torch.testing.assert_close(filled[1, 2, 0], (traces[1, 1, 0] + traces[1, 3, 0]) / 2)
    torch.testing.assert_close(filled[[0, 2]], traces[[0, 2]])


def test_a_silent_sensor_cannot_be_filled():
    with pytest.raises(InputError, match="sensor number 2 has no value"):
        fill_missing(torch.tensor([[1.0, NAN], [2.0, NAN]]))
