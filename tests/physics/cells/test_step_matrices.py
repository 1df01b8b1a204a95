"""Functions of matrices in exponential steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from dashred.physics.cells.exponential import phi_functions, step_matrices


@pytest.mark.parametrize("scale", [0.01, 1.0, 300.0])
def test_phi_functions_are_those_of_the_augmented_exponential(scale):
    points, n = 6, 4
    matrix = scale * (np.eye(points, k=1) + np.eye(points, k=-1) - 2 * np.eye(points))
    # exp of [[A, I, 0, …], [0, 0, I, …], …] has the functions in its first row of blocks.
    whole = np.zeros((n * points, n * points))
    whole[:points, :points] = matrix
    whole[:-points, points:] += np.eye((n - 1) * points)
    first = expm(whole)[:points].reshape(points, n, points)
    for k, phi in enumerate(phi_functions(matrix)):
        assert phi == pytest.approx(first[:, k], abs=1e-12)


def test_a_constant_rate_without_a_linear_part_is_integrated_exactly():
    step = step_matrices(np.zeros((2, 2)), 0.5)
    assert step.first + 2 * step.middle + step.last == pytest.approx(0.5 * np.eye(2))
    assert step.full == pytest.approx(np.eye(2))
