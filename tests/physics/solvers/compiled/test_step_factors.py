"""Compiled coefficients of ETDRK4 steps against those in torch."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.physics.solvers.compiled.step_factors import real_if_possible, step_factors
from dashred.physics.solvers.etdrk4 import coefficients

LENGTHS = [0.01, 0.3]


def _linear(imaginary: float) -> np.ndarray:
    """Return L of 3 rows, 2 fields and 4 × 5 modes, with h·L from 1e-8 to 300."""
    size = np.geomspace(1e-6, 1e3, 3 * 2 * 4 * 5).reshape(3, 2, 4, 5)
    return -size * (1 + imaginary * 1j) + 0.0j


@pytest.mark.parametrize("imaginary", [0.0, 0.5])
def test_coefficients_are_those_in_torch(imaginary: float) -> None:
    linear = _linear(imaginary)
    found = step_factors(real_if_possible(linear), LENGTHS)
    assert found.shape == (2, 6, 3, 2, 20)
    for of_step, h in zip(found, LENGTHS, strict=True):
        expected = torch.stack(list(coefficients(torch.from_numpy(linear), h))).flatten(3).numpy()
        # For |z| > 1 the recurrence loses up to two digits of what two exponentials differ by.
        np.testing.assert_allclose(of_step, expected, rtol=1e-13, atol=0)


def test_a_row_alone_has_the_same_bits() -> None:
    linear = _linear(0.5)
    whole = step_factors(linear, LENGTHS)
    np.testing.assert_array_equal(step_factors(linear[1:2], LENGTHS), whole[:, :, 1:2])


def test_only_a_linear_part_without_imaginary_values_becomes_real() -> None:
    assert not np.iscomplexobj(real_if_possible(_linear(0.0)))
    assert np.iscomplexobj(real_if_possible(_linear(0.5)))


def test_growing_modes_and_a_mode_at_rest() -> None:
    [[full, half, q, first, middle, last]] = step_factors(np.array([[[0.0, 2.0]]]), [0.5])
    np.testing.assert_allclose(full[0, 0], [1, np.e], rtol=1e-15)
    np.testing.assert_allclose(half[0, 0], [1, np.exp(0.5)], rtol=1e-15)
    np.testing.assert_allclose(q[0, 0], [0.25, (np.exp(0.5) - 1) / 2], rtol=1e-15)
    # At rest N is weighted as in Simpson's rule; the middle one is that of each of two stages.
    weights = [first[0, 0, 0], middle[0, 0, 0], last[0, 0, 0]]
    np.testing.assert_allclose(weights, [0.5 / 6, 0.5 / 3, 0.5 / 6], rtol=1e-15)
