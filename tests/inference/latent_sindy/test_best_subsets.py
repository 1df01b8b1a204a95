"""The best sets of terms of each size."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from dashred.inference.latent_sindy.best_subsets import best_subsets
from dashred.inference.latent_sindy.blocks import Blocks


@pytest.fixture
def problem() -> tuple[np.ndarray, np.ndarray]:
    """Columns and a target of two of them, of very different sizes, with noise."""
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(6, 40)) * np.array([1e-6, 1.0, 1e4, 1.0, 10.0, 1.0])[:, None]
    target = 2e6 * columns[0] - 3.0 * columns[3] + rng.normal(0, 0.3, 40)
    return columns, target


def test_each_size_has_the_lowest_squared_error(problem):
    columns, target = problem
    support = [0, 2, 3, 5]
    found = best_subsets(Blocks.from_arrays(target[None], columns[None]), support)
    for size, coefficients in enumerate(found):
        errors = []
        for subset in combinations(support, size):
            fit = np.linalg.lstsq(columns[list(subset)].T, target, rcond=None)[0]
            errors.append(np.square(target - fit @ columns[list(subset)]).sum())
        assert np.square(target - coefficients @ columns).sum() == pytest.approx(min(errors))
        assert np.count_nonzero(coefficients) == size
    assert found[2].nonzero()[0].tolist() == [0, 3]


def test_no_terms_have_one_set_without_coefficients(problem):
    columns, target = problem
    [found] = best_subsets(Blocks.from_arrays(target[None], columns[None]), [])
    assert not found.any()


def test_two_equal_columns_are_solved(problem):
    columns, target = problem
    columns[5] = columns[3]
    found = best_subsets(Blocks.from_arrays(target[None], columns[None]), [3, 5])
    assert found[2] @ columns == pytest.approx(found[1] @ columns)
