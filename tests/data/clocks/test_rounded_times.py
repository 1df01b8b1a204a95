"""Even clocks are recovered from times that a file rounds until they repeat."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashred.data.clocks.rounded_times import even_times, without_rounding


@given(st.floats(0.0021, 0.0099), st.floats(-50, 50), st.integers(60, 400), st.sampled_from("fet"))
def test_an_even_clock_is_recovered(step: float, first: float, count: int, form: str) -> None:
    exact = first + step * np.arange(count)
    cells = {
        "f": [f"{t:.2f}" for t in exact],
        "e": [f"{t:.3e}" for t in exact],
        "t": [f"{np.floor(100 * t) / 100:.2f}" for t in exact],
    }[form]
    written = np.array([float(cell) for cell in cells])
    repeated = int((np.diff(written) == 0).sum())
    even = even_times(written, cells)
    if not 5 <= repeated <= 0.4 * count:
        assert even is None
        return
    assert even is not None
    np.testing.assert_allclose(np.diff(even), np.diff(even).mean(), rtol=1e-6)
    digit = np.array([0.01 if form != "e" else 10.0 ** (int(c[-3:]) - 3) for c in cells])
    assert (np.abs(even - written) <= 1.01 * digit).all()
    assert np.diff(even).mean() == pytest.approx(step, abs=0.03 / count)


def test_times_in_another_unit_keep_their_clock() -> None:
    cells = [f"{0.8 * i:.0f}" for i in range(50)]
    even = even_times(0.001 * np.array([float(cell) for cell in cells]), cells)
    assert even is not None
    assert np.diff(even).mean() == pytest.approx(0.0008, rel=0.02)


@pytest.mark.parametrize(
    "times",
    [
        np.repeat(np.arange(20.0), 2),
        np.r_[0.0, 0.0, np.arange(0.5, 20.0, 0.5)],
        np.r_[np.arange(10.0), np.arange(12.0, 20.0), 19.0],
        np.r_[0.0, 0.0, 1.0, 0.5, 2.0],
        np.arange(20.0),
        np.r_[np.arange(10.0), np.arange(9.0, 20.0)],
        np.where(np.arange(40) % 7 == 3, np.nan, np.floor(0.7 * np.arange(40))),
        np.zeros(1),
        np.zeros(0),
    ],
    ids=[
        "pairs",
        "glitch",
        "gap",
        "decreasing",
        "no repetition",
        "one row twice",
        "missing",
        "one",
        "none",
    ],
)
def test_other_times_stay(times: np.ndarray) -> None:
    cells = ["" if np.isnan(t) else f"{t:.0f}" for t in times]
    assert even_times(times, cells) is None
    same, is_rounded = without_rounding(times, cells, [slice(0, len(times))])
    assert same is times and not is_rounded


def test_dates_stay() -> None:
    assert even_times(np.zeros(3), ["2024-05-17", "2024-05-17", "2024-05-18"]) is None
