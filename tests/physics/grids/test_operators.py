"""Spatial operators against closed forms."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.physics.grids.finite_differences import FiniteDifferences
from dashred.physics.grids.grid import Axis, Grid
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.spectral import Spectral

LENGTH = 3.0
K = 2 * math.pi / LENGTH


def line(points):
    grid = Grid((Axis("x", LENGTH, points),))
    return grid, grid.coordinates["x"]


def sheet():
    grid = Grid((Axis("x", LENGTH, 12), Axis("y", 2 * math.pi, 15)))
    return grid, grid.coordinates["x"], grid.coordinates["y"]


def near(found, expected, atol=1e-9):
    torch.testing.assert_close(found, expected.expand(found.shape), rtol=1e-11, atol=atol)


def nth_derivative(n, waves, x):
    """Of ``Σ cos(mKx + m)``."""
    return sum((m * K) ** n * torch.cos(m * K * x + m + n * math.pi / 2) for m in waves)


@pytest.mark.parametrize("points", [16, 17])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_spectral_derivatives_are_exact_below_the_nyquist_mode(points, order):
    grid, x = line(points)
    ops = Spectral(grid)
    f = nth_derivative(0, range(8), x)
    found = ops.on_grid(ops.derivative(Value(f), "x", order))
    near(found, nth_derivative(order, range(8), x))


def test_odd_derivatives_drop_the_nyquist_mode_and_even_ones_keep_it():
    grid, _ = line(8)
    ops = Spectral(grid)
    zigzag = torch.tensor([1.0, -1.0] * 4, dtype=torch.float64)
    near(ops.on_grid(ops.derivative(Value(zigzag), "x", 1)), torch.zeros(8).double())
    near(ops.on_grid(ops.derivative(Value(zigzag), "x", 2)), -((4 * K) ** 2) * zigzag)


@pytest.mark.parametrize("batch", [(), (4,), (12,), (15,)])
def test_spectral_operators_are_exact_in_the_plane(batch):
    grid, x, y = sheet()
    ops = Spectral(grid)
    sizes = torch.arange(1.0, 1 + math.prod(batch)).double().reshape(*batch, 1, 1)
    f = sizes * torch.cos(2 * K * x) * torch.sin(3 * y)
    k2 = (2 * K) ** 2 + 9
    near(ops.on_grid(ops.laplacian(Value(f))), -k2 * f)
    near(ops.on_grid(ops.inverse_laplacian(Value(f + 7))), -f / k2)
    slope = -2 * K * sizes * torch.sin(2 * K * x) * torch.sin(3 * y)
    near(ops.on_grid(ops.derivative(Value(f), "x", 1)), slope)
    cube = -27 * sizes * torch.cos(2 * K * x) * torch.cos(3 * y)
    near(ops.on_grid(ops.derivative(Value(f), "y", 3)), cube)


def test_a_sum_of_known_modes_and_points_transforms_as_one():
    grid, x = line(16)
    ops = Spectral(grid)
    f, g = torch.sin(K * x), torch.cos(3 * K * x)
    value = ops.derivative(Value(f), "x", 2).scaled(2.0)
    value.parts += Value(g).scaled(-3.0).parts + Value(1.5).parts
    expected = -2 * K**2 * f - 3 * g + 1.5
    near(ops.on_grid(value), expected)
    near(ops.in_modes(value), torch.fft.rfft(expected))
    like = torch.zeros((2, 9), dtype=torch.complex128)
    stacked = ops.stacked_modes([value, Value(2.0), Value(modes=torch.fft.rfft(f))], like)
    rows = torch.stack([expected, torch.full_like(x, 2.0), f])
    near(stacked, torch.fft.rfft(rows).expand(2, 3, 9))


@pytest.mark.parametrize("axis", ["x", "y"])
def test_the_derivative_along_an_axis_leaves_the_other_alone(axis):
    grid, x, y = sheet()
    for ops in (Spectral(grid), FiniteDifferences(grid)):
        other = {"x": torch.sin(y), "y": torch.cos(K * x)}[axis]
        near(ops.on_grid(ops.derivative(Value(other), axis, 1)), torch.zeros(12, 15).double())


def error_of(points, operate, exact):
    grid, x = line(points)
    ops = FiniteDifferences(grid)
    found = ops.on_grid(operate(ops, Value(torch.exp(torch.sin(K * x)))))
    return float((found - exact(torch.sin(K * x), torch.cos(K * x))).abs().max())


@pytest.mark.parametrize(
    ("operate", "exact"),
    [
        (lambda ops, f: ops.derivative(f, "x", 1), lambda s, c: K * c * torch.exp(s)),
        (lambda ops, f: ops.laplacian(f), lambda s, c: K**2 * (c**2 - s) * torch.exp(s)),
        (
            lambda ops, f: ops.derivative(f, "x", 3),
            lambda s, c: K**3 * c * (c**2 - 3 * s - 1) * torch.exp(s),
        ),
    ],
    ids=["first", "laplacian", "third"],
)
def test_finite_differences_converge_with_order_two(operate, exact):
    coarse, fine = (error_of(points, operate, exact) for points in (128, 256))
    assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.05)


def test_finite_differences_invert_the_laplacian():
    grid, x, y = sheet()
    ops = FiniteDifferences(grid)
    f = torch.cos(K * x) * torch.sin(2 * y)
    near(ops.on_grid(ops.inverse_laplacian(Value(f + 1))), -f / (K**2 + 4))


def upwind(points):
    grid, x = line(points)
    u = 2 + torch.sin(K * x)
    ops = FiniteDifferences(grid)
    return x, u, ops.on_grid(ops.flux(Value(u**2 / 2), "x", Value(u)))


def test_the_upwind_flux_conserves_the_mean_and_converges_with_order_one():
    errors = []
    for points in (128, 256):
        x, u, found = upwind(points)
        errors.append(float((found - u * K * torch.cos(K * x)).abs().max()))
        assert abs(float(found.mean())) < 1e-13
    assert math.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.05)


def test_the_upwind_flux_looks_where_the_wind_comes_from():
    grid, x = line(32)
    ops, h = FiniteDifferences(grid), LENGTH / 32
    u = torch.sin(K * x)
    right = ops.on_grid(ops.flux(Value(u), "x", Value(u)))
    left = ops.on_grid(ops.flux(Value(-u), "x", Value(u)))
    near(right, (u - u.roll(1)) / h)
    near(left, -(u.roll(-1) - u) / h)


@pytest.mark.parametrize("points", [16, 17])
def test_interpolation_to_a_finer_grid_is_exact(points):
    grid, x = line(points)
    finer = grid.refined(2)
    f = nth_derivative(0, range(8), x).expand(3, points)
    found = grid.interpolate(f, finer)
    near(found, nth_derivative(0, range(8), finer.coordinates["x"]))
    torch.testing.assert_close(found[..., ::2], f)


def test_interpolation_takes_the_nyquist_mode_as_a_cosine():
    grid, _ = line(8)
    zigzag = torch.tensor([1.0, -1.0] * 4, dtype=torch.float64)
    finer = torch.tensor([1.0, 0.0, -1.0, 0.0] * 4, dtype=torch.float64)
    near(grid.interpolate(zigzag, grid.refined(2)), finer)


def test_interpolation_in_the_plane_is_exact():
    grid, x, y = sheet()
    finer = grid.refined(3)
    X, Y = finer.coordinates["x"], finer.coordinates["y"]
    f = torch.cos(5 * K * x) * torch.sin(6 * y)
    near(grid.interpolate(f, finer), torch.cos(5 * K * X) * torch.sin(6 * Y))
