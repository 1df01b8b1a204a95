"""All modes of real fields."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.physics.grids.full_spectrum import full_spectrum
from dashred.physics.tangents.spectral_columns.pairs import size_of_modes

SHAPES = [(8,), (9,), (6, 8), (5, 6), (6, 9), (4, 5, 6)]


@pytest.mark.parametrize("shape", SHAPES)
def test_all_modes_of_real_fields_follow_from_half_of_them(shape: tuple[int, ...]) -> None:
    fields = np.random.default_rng(1).normal(size=(2, 3, *shape))
    axes = tuple(range(2, 2 + len(shape)))
    expected = np.fft.fftn(fields, axes=axes)
    found = full_spectrum(np.fft.rfftn(fields, axes=axes), shape)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    rms = np.sqrt(np.square(fields).mean(axis=axes))
    np.testing.assert_allclose(size_of_modes(found.reshape(2, 3, -1)), rms)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_field_times_a_symbol_is_that_of_the_real_transform(shape: tuple[int, ...]) -> None:
    """Also for an odd derivative of the highest mode, which a real transform leaves out."""
    rng, axes = np.random.default_rng(2), tuple(range(len(shape)))
    field = rng.normal(size=shape)
    half = np.fft.rfftn(field)
    symbol = rng.normal(size=half.shape) + 1j * rng.normal(size=half.shape)
    expected = np.fft.irfftn(symbol * half, s=shape, axes=axes)
    both = np.fft.ifftn(full_spectrum(symbol * half, shape))
    np.testing.assert_allclose(both.real, expected, atol=1e-12)
    np.testing.assert_allclose(both.imag, 0, atol=1e-12)


def test_axes_in_another_order_and_single_precision() -> None:
    half = np.fft.rfft(np.random.default_rng(3).normal(size=(2, 3, 8)))
    found = full_spectrum(half.swapaxes(0, 1), (8,), np.complex64)
    assert found.dtype == np.complex64
    np.testing.assert_allclose(found, full_spectrum(half, (8,)).swapaxes(0, 1), rtol=1e-6)
