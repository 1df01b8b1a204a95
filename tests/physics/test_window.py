"""Windows against what they promise: 1 inside, 0 outside, half and of slope 1/w at an edge."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr, Name
from dashred.physics.grids.grid import Axis
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.operators import NoSpace
from dashred.physics.window import Shape, Window, box, gate, onset

LENGTH = 20.0
AXIS = Axis("x", LENGTH, 64)


def evaluate(expr: Expr, name: str, points: list[float]) -> torch.Tensor:
    values = {name: Value(torch.tensor(points, dtype=torch.float64))}
    [found] = Program([expr])(values, NoSpace())
    return torch.as_tensor(NoSpace().on_grid(found), dtype=torch.float64).expand(len(points))


def chi(window: Window, name: str, points: list[float]) -> list[float]:
    return evaluate(window.expression, name, points).tolist()


@pytest.mark.parametrize("centre", [3.0, 19.0, -2.5])
def test_a_box_holds_about_its_centre_whatever_period_it_lies_in(centre: float) -> None:
    width = 0.3
    window = box(AXIS).at((centre, 4.0, math.log(width)))
    inside = [centre, centre + 3, centre - 3 + LENGTH]
    outside = [centre + 5, centre - 5, centre + LENGTH / 2]
    edges = [centre - 4, centre + 4, centre + 4 - 2 * LENGTH]
    assert chi(window, "x", inside) == pytest.approx([1, 1, 1], abs=0.01)
    assert chi(window, "x", outside) == pytest.approx([0, 0, 0], abs=0.01)
    assert chi(window, "x", edges) == pytest.approx([0.5, 0.5, 0.5])
    h = 1e-5
    left, right = chi(window, "x", [centre + 4 - h, centre + 4 + h])
    assert (right - left) / (2 * h) == pytest.approx(-0.5 / width, rel=1e-6)


def test_an_onset_and_gates_rise_and_fall_at_their_edge() -> None:
    begun = onset().at((12.0, math.log(0.1)))
    assert chi(begun, "t", [11.0, 12.0, 13.0]) == pytest.approx([0.0, 0.5, 1.0], abs=1e-6)
    above, below = gate("u", 1).at((0.7, math.log(0.05))), gate("u", -1).at((0.7, math.log(0.05)))
    points = [0.4, 0.7, 0.74, 1.2]
    ups, downs = chi(above, "u", points), chi(below, "u", points)
    assert ups[:2] == pytest.approx([0.0, 0.5], abs=1e-4)
    assert [u + d for u, d in zip(ups, downs, strict=True)] == pytest.approx([1.0] * 4)


@pytest.mark.parametrize(
    ("shape", "name", "values"),
    [
        (box(AXIS), "x", (3.0, 4.0, -1.0)),
        (onset(), "t", (5.0, 0.2)),
        (gate("u", 1), "u", (6.0, 0.3)),
        (gate("u", -1), "u", (6.0, 0.3)),
    ],
)
def test_slopes_are_derivatives(shape: Shape, name: str, values: tuple[float, ...]) -> None:
    points, h = [0.5, 2.0, 5.8, 6.6, 9.0], 1e-6
    for place, slope in enumerate(shape.at(values).slopes()):
        moved = [list(values), list(values)]
        moved[0][place] += h
        moved[1][place] -= h
        ahead, behind = (evaluate(shape.at(v).expression, name, points) for v in moved)
        expected = (ahead - behind) / (2 * h)
        torch.testing.assert_close(evaluate(slope, name, points), expected, rtol=1e-6, atol=1e-8)


def test_unknowns_are_no_names_of_the_language() -> None:
    for shape in (box(AXIS), onset(), gate("u", 1)):
        assert not any(name.isidentifier() for name in shape.names)
        assert Name(shape.names[0]) != Name(shape.of)


@pytest.mark.parametrize(
    ("axis", "ends", "expected"),
    [
        (Axis("x", 6.0, 32), (1.0, 2.0), (1.0, 2.0)),
        (Axis("x", 6.0, 32), (5.0, 6.5), (5.0, 0.5)),
        (Axis("x", 6.0, 32), (-1.0, 0.5), (5.0, 0.5)),
        (Axis("x", 6.0, 32), (5.0, 6.0), (5.0, 6.0)),
        (Axis("x", 6.0, 32, "fixed"), (5.0, 6.5), (5.0, 6.0)),
        (Axis("x", 6.0, 32, "fixed"), (11.0, 13.0), (0.0, 1.0)),
    ],
)
def test_an_interval_is_told_in_coordinates_of_the_axis(axis: Axis, ends, expected) -> None:
    assert axis.interval(*ends) == pytest.approx(expected)
    begin, end = expected
    words = f"for {begin:g} < x < {end:g}"
    if begin > end:
        words = f"for x > {begin:g} or x < {end:g}"
    centre, half = sum(ends) / 2, (ends[1] - ends[0]) / 2
    assert str(box(axis).at((centre, half, 0.0))) == words


def test_an_edge_may_be_sharper_than_any_number() -> None:
    """``exp(800)`` is no number of double precision, but the window is a jump."""
    window = onset().at((1.0, -800.0))
    assert chi(window, "t", [0.9, 1.1]) == [0, 1]
    for slope in window.slopes():
        assert evaluate(slope, "t", [0.9, 1.1]).isfinite().all()
