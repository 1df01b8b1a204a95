"""Pairs of real columns as complex ones: all modes, their scales and their places."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.physics.grids.transforms import to_full_modes
from dashred.physics.tangents.spectral_columns.pairs import ColumnPairs, power_of_two

SHAPES = [(8,), (9,), (6, 8), (5, 6), (6, 9)]


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("shape", SHAPES)
def test_columns_return_from_their_modes(shape: tuple[int, ...], count: int) -> None:
    sizes = 10.0 ** np.arange(-6, 3 * count - 6, 3)
    points = np.random.default_rng(3).normal(size=(2, count, *shape))
    points *= sizes.reshape(-1, *(1,) * len(shape))
    pairs = ColumnPairs(power_of_two(sizes), shape)
    paired = pairs.paired(points.astype(np.float32), pairs.count + 1)
    assert paired.shape == (2, (count + 1) // 2 + 1, *shape) and paired.dtype == np.complex64
    assert not paired[:, -1].any()
    modes = to_full_modes(paired, len(shape))
    both = np.fft.ifftn(modes, axes=range(2, modes.ndim))
    parts = np.stack([both.real, both.imag], axis=2).reshape(2, -1, *shape)[:, :count]
    found = parts * pairs.scales.reshape(1, -1, *(1,) * len(shape))
    # Each column keeps single precision, though its partner is a thousand times as large.
    errors = np.abs(found - points).max(axis=(0, *range(2, points.ndim)))
    assert (errors < 1e-6 * sizes).all()


def test_the_place_of_a_source_is_that_of_its_column() -> None:
    pairs = ColumnPairs(np.array([2.0, 4.0, 0.5]), (4,))
    places, factors = pairs.places(np.array([[0, 0, 7], [1, 1, 8], [0, 2, 9]]))
    np.testing.assert_array_equal(places, [[0, 0, 7], [1, 0, 8], [0, 1, 9]])
    np.testing.assert_array_equal(factors, [0.5, 0.25j, 2.0])


def test_scales_are_powers_of_two_and_the_median_for_a_column_of_zeros() -> None:
    found = power_of_two(np.array([3.0, 0.0, 1e-3, np.inf, 1e30]))
    np.testing.assert_array_equal(found, [4.0, 4.0, 2.0**-10, 4.0, 2.0**60])
    np.testing.assert_array_equal(power_of_two(np.zeros(2)), [1.0, 1.0])
