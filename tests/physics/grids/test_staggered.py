"""Finite volumes: identities of their operators."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.physics.grids.cell_interpolation import cell_weights
from dashred.physics.grids.grid import Axis, Grid
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.staggered import Staggered, face_values

AXIS = Axis("x", 2.0, 10, "staggered")
X = torch.arange(21, dtype=torch.float64) * 0.1


def test_a_second_derivative_at_cells_has_the_three_nearest_cells():
    operators, units = Staggered(Grid((AXIS,))), torch.eye(21, dtype=torch.float64)
    second = torch.as_tensor(operators.on_grid(operators.derivative(Value(units), "x", 2))).T
    assert second[5].nonzero().flatten().tolist() == [3, 5, 7]
    assert second[5, 3:8:2].tolist() == pytest.approx([25.0, -50.0, 25.0])


def test_a_derivative_conserves_the_sum_over_the_cells():
    f = torch.rand(21, dtype=torch.float64)
    operators = Staggered(Grid((AXIS,)))
    slope = torch.as_tensor(operators.on_grid(operators.derivative(Value(f), "x", 1)))
    assert float(slope[1::2].sum() * 0.2) == pytest.approx(float(f[-1] - f[0]))


@pytest.mark.parametrize("kinds", [("value", "slope"), ("slope", "value"), ("outflow", "outflow")])
def test_the_faces_of_a_straight_line_are_on_it(kinds):
    line = 3 + 2 * X.numpy()
    given = {"value": line, "slope": np.full(21, 2.0), "outflow": np.zeros(21)}
    matrix, responses = face_values(10, 0.2, *kinds)
    ends = given[kinds[0]][0] * responses["left"] + given[kinds[1]][-1] * responses["right"]
    assert matrix @ line[1::2] + ends == pytest.approx(line)


def test_interpolation_of_a_cubic_is_exact_between_cells_and_at_the_ends():
    places = torch.tensor([0.0, 0.33, 1.0, 1.99, 2.0], dtype=torch.float64)
    assert cell_weights(AXIS, places) @ X**3 == pytest.approx(places**3, abs=1e-12)


def test_the_laplacian_on_a_radius_is_finite_at_the_centre():
    operators = Staggered(Grid((Axis("x", 2.0, 10, "staggered", radial=True),)))
    found = torch.as_tensor(operators.on_grid(operators.laplacian(Value(X**2))))
    assert found[:19] == pytest.approx(torch.full((19,), 4.0, dtype=torch.float64))
