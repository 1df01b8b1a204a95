"""The record is cut into segments and joined again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashred.inference.segments.segments import LARGEST_COUNT, cut


@given(lengths=st.lists(st.integers(2, 40), min_size=1, max_size=4), samples=st.integers(1, 7))
def test_every_reading_is_in_one_segment(lengths: list[int], samples: int) -> None:
    times = [np.linspace(0, 1, length) for length in lengths]
    values = [np.arange(length, dtype=float)[:, None] + 100 * e for e, length in enumerate(lengths)]
    segments = cut(times, values, samples)
    seen = segments.readings[np.isfinite(segments.readings)]
    assert sorted(seen) == sorted(np.concatenate(values).ravel())
    assert segments.seen == sum(lengths)
    for episode, clock in enumerate(times):
        np.testing.assert_array_equal(
            segments.join(segments.times[..., None], episode)[:, 0], clock
        )


def test_neighbours_share_a_sample_within_an_episode_alone() -> None:
    clock = np.arange(9.0)
    segments = cut([clock, clock + 100], [np.zeros((9, 1))] * 2, 4)
    np.testing.assert_array_equal(segments.times[:, 0], [0, 4, 100, 104])
    np.testing.assert_array_equal(segments.times[:, -1], [4, 8, 104, 108])
    assert segments.follows.tolist() == [True, False, True]
    assert segments.begins.tolist() == [0, 2]


def test_a_long_record_has_longer_segments() -> None:
    clock = np.arange(10.0 * LARGEST_COUNT)
    segments = cut([clock], [clock[:, None]], 4)
    assert segments.count <= LARGEST_COUNT
    assert segments.span == pytest.approx(10)
