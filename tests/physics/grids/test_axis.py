"""Intervals on an axis: they wrap around a ring and stop at an end."""

from __future__ import annotations

import pytest

from dashred.physics.grids.grid import Axis


@pytest.mark.parametrize(
    ("begin", "end", "wanted"),
    [(2.0, 4.0, (2.0, 4.0)), (-0.5, 1.5, (9.5, 1.5)), (9.3, 10.3, (9.3, 0.3)),
     (-4.0, 6.0, (0.0, 10.0)), (-0.7, 0.3, (9.3, 0.3))],
)  # fmt: skip
def test_an_interval_on_a_ring(begin: float, end: float, wanted: tuple[float, float]) -> None:
    assert Axis("x", 10.0, 32).interval(begin, end) == pytest.approx(wanted)


def test_an_interval_between_ends() -> None:
    axis = Axis("x", 10.0, 32, "insulated")
    assert axis.interval(-0.5, 1.5) == (0.0, 1.5)
    assert axis.interval(8.5, 10.5) == (8.5, 10.0)
