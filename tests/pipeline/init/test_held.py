"""Inputs that stay and jump, and inputs that vary smoothly, as loggers write them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dashred.pipeline.init.held import changes_in_steps

N = np.arange(1000)
RNG = np.random.default_rng(7)
SLOW = 5 * np.sin(N / 100)
HELD = {
    "a random binary signal of one row each": RNG.integers(0, 2, 1000).astype(float),
    "random levels of two rows each": np.repeat(RNG.normal(size=500), 2),
    "a set point": np.repeat([20, 21.5, 50, 20, 35.2, 18], 100),
    "one step": np.where(N < 300, 0.0, 12.0),
    "steps of equal size and length": np.repeat([0.0, 1, 2, 3], 250),
    "steps of one size": np.repeat([0.0, 10, 20, 30], [200, 100, 300, 400]),
}
STRAIGHT = {
    "smooth": SLOW,
    "rounded": np.round(SLOW, 1),
    "rounded to three values": np.round(22 + SLOW / 5),
    "rounded, with noise": np.round(SLOW + 0.1 * RNG.standard_normal(1000), 1),
    "of a converter with 10 bits": np.round(SLOW / 0.0048828125) * 0.0048828125,
    "the sun, zero at night": np.round(np.maximum(0, 800 * np.sin(N / 30)), 1),
    "ramps between plateaus": np.interp(N, [0, 400, 460, 1000], [20, 20, 80, 80]),
    "constant": np.ones(1000),
    "without a value": np.full(1000, np.nan),
}


@pytest.mark.parametrize("name", HELD)
def test_steps_are_held(name: str) -> None:
    assert changes_in_steps(HELD[name])
    assert changes_in_steps(_with_gaps(HELD[name]))


@pytest.mark.parametrize("name", STRAIGHT)
def test_what_is_smooth_is_not_held(name: str) -> None:
    assert not changes_in_steps(STRAIGHT[name])
    assert not changes_in_steps(_with_gaps(STRAIGHT[name]))


def _with_gaps(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values in every second row, as of a second logger."""
    return np.stack([values, np.full(len(values), np.nan)], axis=1).ravel()
