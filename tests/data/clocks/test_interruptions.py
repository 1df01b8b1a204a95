"""Interruptions of a sampling, and samplings that are uneven by design."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.data.clocks.interruptions import interruptions
from dashred.data.clocks.resampling import native_step

DOSE = np.array([0, 0.25, 0.5, 1, 2, 3.5, 5, 7, 9, 12, 24])


def found(times: np.ndarray, *others: np.ndarray) -> list[int]:
    return interruptions(times, 10 * native_step(times), others).tolist()


@pytest.mark.parametrize(
    "times", [DOSE, np.geomspace(1, 1000, 20), np.geomspace(1, 4**9, 10), np.arange(9.0)]
)
def test_intervals_that_grow_smoothly_are_no_interruption(times: np.ndarray) -> None:
    assert found(times) == []


def test_a_pause_in_an_even_sampling_is_an_interruption() -> None:
    times = np.delete(np.arange(60.0), range(20, 35))
    assert found(times) == [19]
    alone = np.delete(np.arange(90.0), [*range(20, 35), *range(36, 51)])
    assert found(alone) == [19, 20]


def test_a_pause_at_the_same_time_of_most_episodes_is_a_design() -> None:
    night = np.concatenate([np.arange(0, 8, 0.25), np.arange(24, 32, 0.25)])
    early = night + 0.5
    whole = np.arange(0, 32, 0.25)
    assert found(night) == [31]
    assert found(night, early) == []
    assert found(night, early, whole) == []
    assert found(night, early, whole, whole) == [31]
    assert found(night, whole) == [31]
