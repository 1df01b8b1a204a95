"""A regression problem as normal equations of its blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Blocks:
    """The normal equations of each block of a regression problem ``A ξ ≈ b``.

    Attributes:
        gram: ``AᵀA`` of each block, ``(block, term, term)``.
        moment: ``Aᵀb``, ``(block, term)``.
        power: ``bᵀb``, ``(block,)``.
        rows: number of rows of each block, ``(block,)``.
    """

    gram: Array
    moment: Array
    power: Array
    rows: Array

    @classmethod
    def from_arrays(cls, target: Array, columns: Array) -> Blocks:
        """Build from targets ``(block, row)`` and columns ``(block, term, row)``."""
        return cls(
            np.einsum("bir,bjr->bij", columns, columns),
            np.einsum("bir,br->bi", columns, target),
            np.einsum("br,br->b", target, target),
            np.full(len(target), target.shape[1], dtype=np.float64),
        )

    def columns(self, index: NDArray[np.intp], factors: Array) -> Blocks:
        """Return the problem with some of the columns, each multiplied by a factor."""
        gram = self.gram[:, index[:, None], index] * factors * factors[:, None]
        return Blocks(gram, self.moment[:, index] * factors, self.power, self.rows)

    def weighted(self, weights: Array) -> Blocks:
        """Return the problem with a weight on each block, ``(block,)``."""
        w = weights[:, None]
        return Blocks(
            self.gram * w[:, None], self.moment * w, self.power * weights, self.rows * weights
        )

    def selected(self, included: NDArray[np.bool_]) -> Blocks:
        """Return the problem of some of the blocks."""
        parts = (self.gram, self.moment, self.power, self.rows)
        return Blocks(*(part[included] for part in parts))
