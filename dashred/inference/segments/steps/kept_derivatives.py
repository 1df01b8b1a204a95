"""Derivatives of a step by segment, which are used again near where they were computed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dashred.inference.segments.segments import Array

# A derivative is used again at states that differ by less than this share of the largest value of
# each field, and at parameters that differ by less than this share of their values. An error of a
# percent in a derivative is harmless.
NEAR = 0.01


@dataclass
class KeptDerivatives:
    """Derivatives of one step of all segments, ``(segment, …)``, and where they were computed.

    Attributes:
        places: states and parameters, ``(segment, place)``.
        values: the derivatives there.
    """

    places: Array = field(default_factory=lambda: np.empty((0, 0)))
    values: Array = field(default_factory=lambda: np.empty(0))

    def far(self, places: Array, reach: Array) -> NDArray[np.intp]:
        """Return the segments whose derivatives were computed elsewhere.

        Args:
            places: states and parameters, ``(segment, place)``.
            reach: their sizes, ``(place,)``.
        """
        if self.places.shape != places.shape:
            return np.arange(len(places))
        # Written with "not", because a state may be NaN. A parameter may be 0.
        near = np.abs(places - self.places) <= NEAR * reach
        return np.flatnonzero(~near.all(axis=1))

    def renewed(self, rows: NDArray[np.intp], places: Array, values: Array) -> Array:
        """Keep the derivatives ``(row, …)`` of some segments; return those of all.

        Args:
            rows: segments whose derivatives are new: all that are far.
            places: states and parameters of all segments, ``(segment, place)``.
            values: the new derivatives.
        """
        if len(rows) == len(places):
            self.places, self.values = places, values
        else:
            # What was returned before does not change.
            self.places, self.values = self.places.copy(), self.values.copy()
            self.places[rows], self.values[rows] = places[rows], values
        return self.values
