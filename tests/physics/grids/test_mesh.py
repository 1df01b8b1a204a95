"""A mesh does what a grid does, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.mesh import Mesh
from dashred.physics.grids.scattered import Scattered
from tests.physics.grids.test_stencils import scattered


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return Mesh(("x", "y"), scattered(400, 2) * [2.0, 1.0] + [-1.0, 3.0])


def test_its_axes_have_the_extent_of_the_nodes(mesh: Mesh) -> None:
    x, y = mesh.axes
    assert (x.name, x.begin, x.length) == ("x", -1.0, 2.0)
    assert (y.begin, y.length) == (3.0, 1.0)
    assert x.interval(-3.0, 0.5) == (-1.0, 0.5)
    assert not (x.periodic or x.mirrored or x.staggered)
    assert mesh.shape == (len(mesh.nodes),)
    assert mesh.dimensions == ("node",)


def test_the_ends_are_within_the_axes() -> None:
    for begin, end in np.random.default_rng(0).normal(size=(200, 2)).tolist():
        low, high = min(begin, end), max(begin, end)
        line = Mesh(("s",), np.linspace(low, high, 9)[:, None])
        assert line.contains((high,)) and line.contains((low,))
        assert line.axes[0].length == pytest.approx(high - low, rel=1e-12)


def test_derivatives_of_a_batch(mesh: Mesh) -> None:
    operators = Scattered(mesh)
    x, y = mesh.coordinates.values()
    fields = torch.stack([torch.sin(x + 2 * y), x * y**2])[None]
    along_y = operators.on_grid(operators.derivative(Value(fields), "y", 1))
    lap = torch.as_tensor(operators.on_grid(operators.laplacian(Value(fields))))
    exact = torch.stack([2 * torch.cos(x + 2 * y), 2 * x * y])[None]
    torch.testing.assert_close(along_y, exact, atol=4e-3, rtol=0)
    torch.testing.assert_close(lap[0, 1], 2 * x, atol=1e-6, rtol=0)
    assert float((lap[0, 0] + 5 * fields[0, 0]).square().mean().sqrt()) < 0.2


def test_sparse_matrices_of_many_nodes() -> None:
    mesh = Mesh(("x", "y"), scattered(1000, 2))
    x, y = mesh.coordinates.values()
    assert mesh.derivatives[()].is_sparse
    operators = Scattered(mesh)
    found = operators.on_grid(operators.laplacian(Value((x * y**2).expand(3, 1, -1))))
    torch.testing.assert_close(found, (2 * x).expand(3, 1, -1), atol=1e-6, rtol=0)


def test_derivatives_of_a_coordinate_and_of_a_number(mesh: Mesh) -> None:
    operators = Scattered(mesh)
    slope = operators.on_grid(operators.derivative(Value(mesh.coordinates["x"]), "x", 1))
    constant = operators.on_grid(operators.laplacian(Value(2.0)))
    torch.testing.assert_close(slope, torch.ones(mesh.shape).double(), atol=1e-9, rtol=0)
    torch.testing.assert_close(constant, torch.zeros(mesh.shape).double(), atol=1e-8, rtol=0)


def test_derivatives_can_be_differentiated(mesh: Mesh) -> None:
    operators = Scattered(mesh)
    field = mesh.coordinates["x"].clone().requires_grad_()
    torch.as_tensor(operators.on_grid(operators.derivative(Value(field), "x", 1))).sum().backward()
    row = torch.ones(mesh.shape).double() @ mesh.derivatives[1, 0].to_dense()
    torch.testing.assert_close(field.grad, row)


def test_volumes_integrate_linear_functions(mesh: Mesh) -> None:
    x, y = mesh.coordinates.values()
    assert mesh.volume(torch.ones(mesh.shape).double()) == pytest.approx(2.0, rel=1e-12)
    assert mesh.volume(x + y) == pytest.approx(2.0 * 3.5, rel=1e-12)
    line = Mesh(("s",), scattered(30, 1))
    assert line.volume(line.coordinates["s"]) == pytest.approx(0.5, rel=1e-12)


def test_the_hull(mesh: Mesh) -> None:
    triangle = Mesh(("x", "y"), np.array([(x, y) for x, y in mesh.nodes if y - 3 <= (x + 1) / 2]))
    for place in mesh.nodes:
        assert mesh.contains(place)
    assert mesh.contains((-1.0, 4.0))
    assert not triangle.contains((-1.0, 4.0))
    # The foot of the perpendicular on the longest side.
    assert triangle.wrap((-0.4, 4.2)) == pytest.approx((-0.04, 3.48), abs=0.02)
    assert triangle.wrap((9.0, 3.0)) == pytest.approx((1.0, 3.0))
    assert triangle.wrap((0.0, 3.2)) == (0.0, 3.2)
    line = Mesh(("s",), scattered(30, 1))
    assert line.contains((1.0,))
    assert not line.contains((1.1,))
    assert line.wrap((1.1,)) == (1.0,)


def test_values_between_the_nodes(mesh: Mesh) -> None:
    places = np.array([[0.1, 3.3], [-0.7, 3.9]])
    field = torch.sin(mesh.coordinates["x"] * mesh.coordinates["y"])
    found = mesh.values_at(places) @ field
    np.testing.assert_allclose(found, np.sin(places.prod(axis=1)), atol=1e-4)


def test_a_picture_is_linear_between_the_nodes_and_empty_outside(mesh: Mesh) -> None:
    x, y = mesh.coordinates.values()
    lines, drawn = mesh.picture(torch.stack([x - 2 * y, y])[None])
    assert drawn.shape == (1, 2, len(lines["x"]), len(lines["y"]))
    exact = lines["x"][:, None] - 2 * lines["y"]
    inside = drawn[0, 0].isfinite()
    assert float(inside.double().mean()) > 0.95
    torch.testing.assert_close(drawn[0, 0][inside], exact[inside])
    corner = Mesh(("x", "y"), np.array([(x, y) for x, y in mesh.nodes if y - 3 <= (x + 1) / 2]))
    _, drawn = corner.picture(torch.zeros(corner.shape).double())
    assert math.isnan(float(drawn[0, -1]))


def test_a_picture_of_a_line_is_in_order() -> None:
    line = Mesh(("s",), scattered(30, 1))
    lines, drawn = line.picture(3 * line.coordinates["s"][None])
    torch.testing.assert_close(drawn[0], 3 * lines["s"])
