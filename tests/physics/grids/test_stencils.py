"""Stencils on scattered nodes against analytic functions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import qmc

from dashred.physics.grids.stencils import DegenerateNodesError, local_weights, stencil_size

Array = NDArray[np.float64]

PLANE = [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]


def scattered(count: int, dimension: int) -> Array:
    """Return nodes in the unit square or interval, also along its ends."""
    if dimension == 1:
        moves = np.random.default_rng(1).uniform(-0.3, 0.3, count)
        inside = (np.arange(count) + 1 + moves) / (count + 1)
        return np.concatenate([inside, [0.0, 1.0]])[:, None]
    margin = 0.4 / count**0.5
    inside = qmc.Halton(2, seed=1).random(count) * (1 - 2 * margin) + margin
    along = np.linspace(0, 1, round(count**0.5))[:-1]
    zero, one = 0 * along, 0 * along + 1
    sides = [(along, zero), (one, along), (1 - along, one), (zero, 1 - along)]
    return np.concatenate([inside, *(np.stack(side, axis=1) for side in sides)])


def order_of(errors: list[float], dimension: int) -> float:
    """Return the order in the distance of the nodes, if their number is four times as large."""
    return float(np.log(errors[0] / errors[1]) / np.log(4 ** (1 / dimension)))


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("dimension", [1, 2])
def test_cubic_polynomials_are_exact(dimension: int) -> None:
    nodes = scattered(60, dimension)
    x, y = nodes[:, 0], nodes[:, -1]
    f = 1 + x - 2 * y**2 + x * y**2
    [value, slope] = local_weights(nodes, nodes, [(0,) * dimension, (1, 0)[:dimension]])
    exact = 1 + y**2 if dimension == 2 else 1 - 4 * x + 3 * x**2
    np.testing.assert_allclose(value @ f, f, atol=1e-10)
    np.testing.assert_allclose(slope @ f, exact, atol=1e-8)


def test_orders_of_convergence_in_the_plane() -> None:
    gradients, laplacians, mixed, readings = [], [], [], []
    places = np.random.default_rng(0).random((80, 2))
    for count in (300, 1200):
        nodes = scattered(count, 2)
        x, y = nodes.T
        f = np.sin(3 * x) * np.cos(2 * y)
        dx, dy, dxx, dxy, dyy = (w @ f for w in local_weights(nodes, nodes, PLANE))
        slopes = 3 * np.cos(3 * x) * np.cos(2 * y), -2 * np.sin(3 * x) * np.sin(2 * y)
        gradients.append(rms(np.stack([dx, dy]) - slopes))
        laplacians.append(rms(dxx + dyy + 13 * f))
        mixed.append(rms(dxy + 6 * np.cos(3 * x) * np.sin(2 * y)))
        [value] = local_weights(nodes, places, [(0, 0)])
        readings.append(rms(value @ f - np.sin(3 * places[:, 0]) * np.cos(2 * places[:, 1])))
    assert order_of(gradients, 2) > 2.7
    assert order_of(laplacians, 2) > 1.7
    assert order_of(mixed, 2) > 1.7
    assert order_of(readings, 2) > 3.4
    assert readings[1] < 1e-6


def test_orders_of_convergence_on_a_line() -> None:
    slopes, curvatures = [], []
    for count in (40, 160):
        nodes = scattered(count, 1)
        f = np.sin(5 * nodes[:, 0])
        first, second = (w @ f for w in local_weights(nodes, nodes, [(1,), (2,)]))
        slopes.append(rms(first - 5 * np.cos(5 * nodes[:, 0])))
        curvatures.append(rms(second + 25 * f))
    assert order_of(slopes, 1) > 2.7
    assert order_of(curvatures, 1) > 1.7


def test_diffusion_by_the_stencils_does_not_grow() -> None:
    nodes = scattered(200, 2)
    dxx, dyy = local_weights(nodes, nodes, [(2, 0), (0, 2)])
    values = np.linalg.eigvals((dxx + dyy).toarray())
    assert values.real.max() < 1e-6 * np.abs(values).max()


def test_a_stencil_on_a_line_gets_more_nodes() -> None:
    along = np.linspace(0, 1, 2 * stencil_size(2))
    line = np.stack([along, 0 * along], axis=1)
    rows = np.concatenate([line + np.array([0, 0.3 * k]) for k in range(4)])
    weights, slope = local_weights(rows, rows[:1], [(0, 0), (0, 1)])
    assert np.diff(weights.indptr)[0] > stencil_size(2)
    y = rows[:, 1]
    np.testing.assert_allclose(slope @ (y - y**3), [1.0], atol=1e-9)


def test_nodes_on_three_lines_are_refused() -> None:
    along = np.linspace(0, 1, 20)
    rows = np.concatenate([np.stack([along, 0 * along + k], axis=1) for k in range(3)])
    with pytest.raises(DegenerateNodesError):
        local_weights(rows, rows, [(0, 0)])
