"""Covariances of the errors of a forecast, and the gain that they give."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Covariances(NamedTuple):
    """Covariances of sensors with quantities and with the state, and variances.

    The sensors are the first ones of the quantities.

    Attributes:
        between: of sensors and quantities, ``(sensor, quantity)``.
        across: of sensors and the state, ``(sensor, field*point)``.
        of_quantities: variances of the quantities, ``(quantity,)``.
        of_state: variances of the state, ``(field*point,)``.
    """

    between: Array
    across: Array
    of_quantities: Array
    of_state: Array

    @classmethod
    def of_errors(cls, errors: Array, of_quantities: Array, tapers: Array) -> Self:
        """Return the mean squares and products of errors, localised.

        Args:
            errors: of the state, ``(member, field*point)``.
            of_quantities: of sensors and further quantities, ``(member, quantity)``.
            tapers: localisation, ``(sensor, quantity and field*point)``.
        """
        sensors, quantities = len(tapers), of_quantities.shape[1]
        known = of_quantities[:, :sensors].T / len(errors)
        return cls(
            between=tapers[:, :quantities] * (known @ of_quantities),
            across=tapers[:, quantities:] * (known @ errors),
            of_quantities=np.square(of_quantities).mean(axis=0),
            of_state=np.square(errors).mean(axis=0),
        )

    def blended(self, other: Self, share: float) -> Self:
        """Return a weighted mean; the other has a share of it."""
        pairs = zip(self, other, strict=True)
        return type(self)(*((1 - share) * own + share * others for own, others in pairs))

    def of_readings(self, noise: Array, known: NDArray[np.intp] | NDArray[np.bool_]) -> Array:
        """Return the covariance of the innovations of the known sensors.

        Args:
            noise: σ of each sensor, ``(sensor,)``.
            known: sensors with a reading, as indices or as a mask.
        """
        between = self.between[:, : len(noise)][known][:, known]
        return np.asarray(between + np.diag(np.square(noise[known])), dtype=np.float64)

    def gain(self, noise: Array, known: NDArray[np.intp] | NDArray[np.bool_]) -> Array:
        """Return the gain K of the known sensors, ``(known sensor, field*point)``."""
        expected = self.of_readings(noise, known)
        return np.asarray(np.linalg.solve(expected, self.across[known]), dtype=np.float64)

    def analysed_variances(
        self, noise: Array, known: NDArray[np.intp] | NDArray[np.bool_]
    ) -> Array:
        """Return the variances of the state after the analysis, ``(field*point,)``."""
        factor = np.linalg.cholesky(self.of_readings(noise, known))
        explained = np.square(np.linalg.solve(factor, self.across[known])).sum(axis=0)
        found: Array = (self.of_state - explained).clip(min=0)
        return found
