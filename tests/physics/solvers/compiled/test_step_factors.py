"""Compiled coefficients of ETDRK4 steps against those in torch."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from dashred.physics.solvers.compiled.step_factors import step_factors
from dashred.physics.solvers.etdrk4 import coefficients

LENGTHS = [0.01, 0.3]


def _linear(imaginary: float) -> np.ndarray:
    """Return L of 3 rows, 2 fields and 4 × 5 modes, with h·L from 1e-8 to 300."""
    size = np.geomspace(1e-6, 1e3, 3 * 2 * 4 * 5).reshape(3, 2, 4, 5)
    return -size * (1 + imaginary * 1j) + 0.0j


@pytest.mark.parametrize("imaginary", [0.0, 0.5])
def test_coefficients_are_those_in_torch(imaginary: float) -> None:
    linear = _linear(imaginary)
    found = step_factors(linear, LENGTHS)
    assert found.shape == (2, 6, 3, 2, 20)
    for of_step, h in zip(found, LENGTHS, strict=True):
        expected = torch.stack(list(coefficients(torch.from_numpy(linear), h))).flatten(3).numpy()
        # For |z| ≥ 1 the recurrence amplifies what two exponentials differ by, up to a hundredfold.
        np.testing.assert_allclose(of_step, expected, rtol=1e-13, atol=0)


@pytest.mark.parametrize("imaginary", [0.0, 0.5])
def test_a_row_alone_has_the_same_bits(imaginary: float) -> None:
    linear = _linear(imaginary)
    whole = step_factors(linear, LENGTHS)
    np.testing.assert_array_equal(step_factors(linear[1:2], LENGTHS), whole[:, :, 1:2])


def test_a_row_beside_complex_ones_has_the_same_bits() -> None:
    linear = np.concatenate([_linear(0.0)[:1], _linear(0.5)[1:]])
    alone = step_factors(linear[:1], LENGTHS)
    np.testing.assert_array_equal(step_factors(linear, LENGTHS)[:, :, :1], alone)


def test_no_rows_give_no_coefficients() -> None:
    assert step_factors(_linear(0.5)[:0], LENGTHS).shape == (2, 6, 0, 2, 20)


def test_growing_modes_and_a_mode_at_rest() -> None:
    [[full, half, q, first, middle, last]] = step_factors(np.array([[[0j, 2.0]]]), [0.5])
    np.testing.assert_allclose(full[0, 0], [1, math.e], rtol=1e-15)
    np.testing.assert_allclose(half[0, 0], [1, np.exp(0.5)], rtol=1e-15)
    np.testing.assert_allclose(q[0, 0], [0.25, (np.exp(0.5) - 1) / 2], rtol=1e-15)
    # At rest the weights are those of Simpson's rule; two stages share the middle one.
    weights = [first[0, 0, 0], middle[0, 0, 0], last[0, 0, 0]]
    np.testing.assert_allclose(weights, [0.5 / 6, 0.5 / 3, 0.5 / 6], rtol=1e-15)
