"""Sizes of the errors of an observer on simulations, by field."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Samples over which errors are compared with expected ones.
WINDOW = 10
TINY = float(np.finfo(np.float64).tiny)


def mean_log_square(errors: Array, fields: int) -> float:
    """Return the mean over fields of the logarithm of the mean squared error.

    Args:
        errors: on simulations, ``(simulation, field*point)``.
        fields: number of fields.
    """
    return float(np.log(np.maximum(_by_field(np.square(errors), fields), TINY)).mean())


class SpreadFactor:
    """Errors on simulations over those that the covariances make expect, in the last samples.

    The covariances of few perturbations are too small or too large.

    Args:
        fields: number of fields.
    """

    def __init__(self, fields: int) -> None:
        self._fields = fields
        self._found: deque[Array] = deque(maxlen=WINDOW)
        self._expected: deque[Array] = deque(maxlen=WINDOW)

    def add(self, errors: Array, variances: Array) -> None:
        """Add the errors of a sample and their variances, ``(simulation, field*point)`` both."""
        self._found.append(_by_field(np.square(errors), self._fields))
        self._expected.append(_by_field(variances, self._fields))

    def scaled(self, variances: Array) -> Array:
        """Return variances ``(field*point,)`` that are right in the mean over the simulations."""
        factor = sum(self._found) / np.maximum(sum(self._expected), TINY)
        found: Array = variances.reshape(self._fields, -1) * factor[:, None]
        return found.reshape(-1)


def _by_field(squares: Array, fields: int) -> Array:
    found: Array = squares.reshape(len(squares), fields, -1).mean(axis=(0, 2))
    return found
