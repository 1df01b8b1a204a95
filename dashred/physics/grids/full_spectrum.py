"""All modes of real fields, given those that a real transform keeps."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Modes = NDArray[Any]
Indices = NDArray[np.int64]

# Marks that there is no index.
NONE = -1


def full_spectrum(half: Modes, shape: tuple[int, ...], dtype: Any = None) -> Modes:
    """Return all modes of real fields, given those that a real transform keeps.

    Symbols of operators are completed in the same way. If a mode and its mirror image are both
    kept, the result is the mean of the mode and the conjugate of its mirror image, as a real
    transform takes it.

    Args:
        half: ``(…, *modes)``.
        shape: of the grid.
        dtype: of the result; by default that of the modes.

    Returns:
        ``(…, *grid)``.
    """
    parts = half.shape[: half.ndim - len(shape)]
    rows = half.reshape(math.prod(parts), math.prod(half.shape[len(parts) :]))
    full = np.empty((len(rows), math.prod(shape)), dtype=dtype or half.dtype)
    _complete(rows, *_places(shape), full)
    return full.reshape(*parts, *shape)


@cache
def _places(shape: tuple[int, ...]) -> tuple[Indices, Indices]:
    """Return which known mode each mode is, and of which one it is the conjugate, ``(mode,)``."""
    *first, last = shape
    kept = last // 2 + 1
    index = np.indices(shape)
    sizes = np.array(shape).reshape(-1, *(1,) * len(shape))

    def place(index: Indices) -> Indices:
        found = np.ravel_multi_index((*index[:-1], np.minimum(index[-1], kept - 1)), (*first, kept))
        return np.where(index[-1] < kept, found, NONE)

    own, mirrored = place(index), place(-index % sizes)
    alone = (own != NONE) & (index[-1] != 0) & (2 * index[-1] != last)
    return own.ravel(), np.where(alone, NONE, mirrored).ravel()


@numba.njit(nogil=True, cache=True)
def _complete(half: Modes, own: Indices, mirrored: Indices, full: Modes) -> None:
    """Set ``full`` to the modes at two places, the second one conjugated, or to their mean."""
    for row in range(len(full)):
        known, out = half[row], full[row]
        for k in range(len(out)):
            if mirrored[k] == NONE:
                out[k] = known[own[k]]
            elif own[k] == NONE:
                out[k] = np.conj(known[mirrored[k]])
            else:
                out[k] = (known[own[k]] + np.conj(known[mirrored[k]])) / 2
