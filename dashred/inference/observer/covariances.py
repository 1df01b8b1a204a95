"""Covariances of the errors of a forecast, and the corrections by readings that they give."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Known = NDArray[np.intp] | NDArray[np.bool_]


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

    def of_innovations(self, noise: Array, known: Known) -> Array:
        """Return the covariance of the innovations of the known sensors.

        Args:
            noise: σ of each sensor, ``(sensor,)``.
            known: sensors with a reading, as indices or as a mask.
        """
        between = self.between[:, : len(noise)][known][:, known]
        return np.asarray(between + np.diag(np.square(noise[known])), dtype=np.float64)

    def update(self, noise: Array, known: Known) -> Update:
        """Return the update by the known sensors.

        Args:
            noise: σ of each sensor, ``(sensor,)``.
            known: sensors with a reading, as indices or as a mask.
        """
        return Update(self.of_innovations(noise, known), self.across, known)


class Update(NamedTuple):
    """The update of states by the readings of some sensors.

    With n sensors, the gain K has n rows as long as a state. It is never formed: a correction is a
    weighted sum of the rows of ``across``.

    Attributes:
        of_innovations: covariance of their innovations, ``(known sensor, known sensor)``.
        across: covariance of what all sensors read and the state, ``(sensor, field*point)``.
        known: sensors with a reading, as indices or as a mask.
    """

    of_innovations: Array
    across: Array
    known: Known

    def corrections(self, innovations: Array) -> Array:
        """Return the correction by each set of innovations, ``(set, field*point)``.

        Args:
            innovations: of the known sensors, ``(set, known sensor)``.
        """
        weights = np.zeros((len(self.across), len(innovations)))
        weights[self.known] = np.linalg.solve(self.of_innovations, innovations.T)
        return np.asarray(weights.T @ self.across, dtype=np.float64)

    def variances(self, of_state: Array) -> Array:
        """Return the variances of the state after the update, ``(field*point,)``.

        Args:
            of_state: those before it.
        """
        factor = np.linalg.cholesky(self.of_innovations)
        explained = np.square(np.linalg.solve(factor, self.across[self.known])).sum(axis=0)
        found: Array = (of_state - explained).clip(min=0)
        return found
