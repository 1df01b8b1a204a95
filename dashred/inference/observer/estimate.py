"""An estimated state with perturbations, which show where its error grows.

The perturbations d run through the simulator beside the estimate. Their covariance follows the
state, but has few directions. It is therefore blended with the mean covariance P̄ over simulations
(Hamill & Snyder, Mon. Weather Rev. 128, 2000)::

    P = s P̄ + (1 − s) ⟨d dᵀ⟩        K = P Hᵀ (H P Hᵀ + R)⁻¹        s = s∞ + (1 − s∞) exp(−t/τ)
    û = ũ + K (y − H ũ)             d ← d − K H d / 2

The last equation is that of Sakov & Oke (Tellus A 60, 2008). After t samples the perturbations have
turned to the directions in which errors grow; before that, P̄ is the better one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.covariances import Covariances, Update

Array = NDArray[np.float64]

# Number of perturbations. Share s∞ of the mean covariance, and the number of samples τ in which the
# share falls towards it.
PERTURBATIONS, SHARE, TURNING = 8, 0.1, 8.0
# Factor on the perturbations in each forecast, and the part of a difference of two simulations that
# each of them gets. Without it, all would turn to the direction in which errors grow fastest.
INFLATION, RENEWAL = 1.02, 1e-3


class Estimate:
    """A state and its perturbations.

    Attributes:
        state: ``(1, field*point)``.
        perturbations: ``(perturbation, field*point)``. Without any, the gain is the mean one.
    """

    def __init__(self, state: Array, perturbations: Array) -> None:
        self.state, self.perturbations = state, perturbations
        self._samples = 0

    @property
    def states(self) -> Array:
        """The state, and the state with each perturbation, ``(1 + perturbation, field*point)``."""
        if not len(self.perturbations):
            return self.state
        return np.concatenate([self.state, self.state + self.perturbations])

    def is_near(self, centre: Array, reach: float) -> bool:
        """Return whether no value of :attr:`states` is farther than so much from a state.

        Args:
            centre: the state, ``(field*point,)``.
            reach: the largest distance.
        """
        # False as well for NaN, after a blow-up.
        return bool(np.abs(self.states - centre).max() <= reach)

    def arrive(self, states: Array, differences: Array) -> None:
        """Take the forecasts of all states.

        Args:
            states: forecasts of :attr:`states`.
            differences: of random pairs of simulations, ``(perturbation, field*point)``.
        """
        self._samples += 1
        self.state = states[:1]
        grown = states[1:] - self.state
        self.perturbations = INFLATION * grown + RENEWAL / math.sqrt(2) * differences

    def covariances(self, mean: Covariances, read: Array, tapers: Array) -> Covariances:
        """Return the blended covariances of the forecast.

        Args:
            mean: over simulations.
            read: quantities of :attr:`states`, ``(1 + perturbation, quantity)``.
            tapers: localisation, ``(sensor, quantity and field*point)``.
        """
        if not len(self.perturbations):
            return mean
        own = Covariances.of_errors(self.perturbations, read[1:] - read[:1], tapers)
        share = SHARE + (1 - SHARE) * math.exp(-self._samples / TURNING)
        return own.blended(mean, share)

    def correct(self, innovation: Array, read: Array, update: Update) -> None:
        """Correct the state and the perturbations.

        Args:
            innovation: of the known sensors, ``(known sensor,)``.
            read: what they read of :attr:`states`, ``(1 + perturbation, known sensor)``.
            update: by the known sensors.
        """
        found = update.corrections(np.concatenate([innovation[None], read[1:] - read[:1]]))
        self.state = self.state + found[:1]
        self.perturbations = self.perturbations - found[1:] / 2
