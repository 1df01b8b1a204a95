"""Which sensors are next to each other."""

from __future__ import annotations

import pytest

from dashred.data.sensors import Sensor
from dashred.inference.sensor_faults.neighbours import has_neighbours
from dashred.physics.grids.grid import Axis

LINE = [Sensor(f"s{j}", "u", (float(j),)) for j in range(10)]
PLANE = [Sensor(f"s{j}{k}", "u", (float(j), float(k))) for j in range(5) for k in range(5)]


@pytest.mark.parametrize(
    ("chosen", "ends", "expected"),
    [
        ([3, 4], "periodic", True),
        ([3, 5], "periodic", False),
        ([0, 9], "periodic", True),
        ([0, 9], "insulated", False),
        ([2, 6, 7], "insulated", True),
        ([5], "periodic", False),
        ([], "periodic", False),
    ],
)
def test_on_a_line(chosen: list[int], ends: str, expected: bool) -> None:
    axis = Axis("x", 10.0, 20, ends)
    assert has_neighbours(LINE, [LINE[j] for j in chosen], [axis]) is expected


@pytest.mark.parametrize(("other", "expected"), [("s23", True), ("s32", True), ("s44", False)])
def test_in_the_plane(other: str, expected: bool) -> None:
    axes = [Axis("x", 5.0, 10), Axis("y", 5.0, 10)]
    chosen = [s for s in PLANE if s.name in {"s22", other}]
    assert has_neighbours(PLANE, chosen, axes) is expected


def test_sensors_of_different_quantities_and_systems_without_axes_have_no_neighbours() -> None:
    axis = Axis("x", 10.0, 20)
    assert not has_neighbours(LINE, [LINE[3], Sensor("v", "v", (4.0,))], [axis])
    points = [Sensor(name, name, ()) for name in "ab"]
    assert not has_neighbours(points, points, [])
