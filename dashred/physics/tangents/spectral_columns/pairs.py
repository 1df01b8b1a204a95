"""Two real columns of a sensitivity as one complex column: its real and its imaginary part.

The linearised equations are real, so they advance both parts independently. A complex transform of
half as many columns is several times as fast as the real transforms of all of them.

Rounding errors of one part reach the other. The columns are scaled to similar size, so that these
errors are those of single precision for both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Real = NDArray[Any]
Modes = NDArray[Any]


@dataclass(frozen=True)
class ColumnPairs:
    """Which columns form pairs, and their scales. An odd number is completed by a column of zeros.

    Attributes:
        scales: what each column is divided by, ``(column,)``; powers of two.
        shape: of the grid.
    """

    scales: Real
    shape: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of pairs."""
        return (len(self.scales) + 1) // 2

    def paired(self, points: Real, count: int) -> Modes:
        """Return columns as pairs, completed by pairs of zeros.

        Args:
            points: columns on the grid, ``(field, column, *grid)``.
            count: number of pairs, with those of zeros.

        Returns:
            Complex values, ``(field, pair, *grid)``.
        """
        parts = np.zeros((len(points), count, *self.shape, 2), dtype=points.dtype)
        scales = self.scales.astype(points.dtype).reshape(1, -1, *(1,) * len(self.shape))
        scaled = points / scales
        parts[:, : self.count, ..., 0] = scaled[:, 0::2]
        parts[:, : points.shape[1] // 2, ..., 1] = scaled[:, 1::2]
        return parts.view(np.result_type(points.dtype, np.complex64))[..., 0]

    def places(self, places: NDArray[np.int64]) -> tuple[NDArray[np.int64], Modes]:
        """Return the places of sources in pairs, and the factors of the sources there.

        Args:
            places: ``(equation, column, index)`` of each source, ``(source, 3)``.

        Returns:
            ``(equation, pair, index)``, ``(source, 3)``; and the factors, ``(source,)``.
        """
        equations, columns, indices = places.T
        factors = np.where(columns % 2, 1j, 1.0) / self.scales[columns]
        return np.column_stack([equations, columns // 2, indices]), factors


def power_of_two(sizes: Real) -> Real:
    """Return the powers of two next to some sizes; for a size without a value, the median one.

    Args:
        sizes: ``(column,)``; a column that is zero or not finite has none.
    """
    known = (sizes > 0) & np.isfinite(sizes)
    typical = float(np.median(sizes[known])) if known.any() else 1.0
    exponents = np.round(np.log2(np.where(known, sizes, typical)))
    # Also the reciprocal must be a number in single precision.
    found: Real = np.exp2(np.clip(exponents, -60, 60))
    return found


def size_of_modes(modes: Modes) -> Real:
    """Return the rms on the grid of fields, given all modes ``(…, mode)``."""
    found: Real = np.sqrt(np.square(np.abs(modes)).sum(axis=-1)) / modes.shape[-1]
    return found
