"""Unknowns that walk from segment to segment: forces in equations, and errors of sensors.

A force f has one value per segment. The error of a sensor has a value b and a slope s at the
beginning of each segment, of duration T::

    f_{k+1} = f_k + e_k        b_{k+1} = b_k + T s_k + e_k        s_{k+1} = s_k + d_k

The increments e and d, and the values in an episode's first segment, are normal with mean zero.
A standard deviation of zero means that there is no such cause.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dashred.inference.segments.segments import Array, Segments


@dataclass(frozen=True)
class Walks:
    """Forces and sensor errors, with their prior.

    The components are the forces, then the value and the slope of every sensor error.

    Attributes:
        forced: indices of the equations that are forced.
        erring: indices of the sensors that err.
        first: std of each component in an episode's first segment, ``(component,)``.
        increment: std of its increments, ``(component,)``.
    """

    forced: tuple[int, ...]
    erring: tuple[int, ...]
    first: Array
    increment: Array

    @property
    def count(self) -> int:
        """Number of components."""
        return len(self.forced) + 2 * len(self.erring)

    def forces(self, walked: Array, fields: int) -> Array | float:
        """Return the force in every equation, ``(segment, field)``; 0 without any.

        Args:
            walked: components in every segment, ``(segment, component)``.
            fields: number of equations.
        """
        if not self.forced:
            return 0.0
        found = np.zeros((len(walked), fields))
        found[:, list(self.forced)] = walked[:, : len(self.forced)]
        return found

    def errors(self, segments: Segments, walked: Array) -> Array | float:
        """Return the errors of the sensors, ``(segment, sample, sensor)``; 0 without any."""
        if not self.erring:
            return 0.0
        found: Array = np.einsum("kisc,kc->kis", self.error_slopes(segments), walked)
        return found

    def error_slopes(self, segments: Segments) -> Array:
        """Return the derivatives of the errors, ``(segment, sample, sensor, component)``."""
        found = np.zeros((*segments.readings.shape, self.count))
        since = segments.times - segments.times[:, :1]
        for sensor, place in zip(self.erring, self._values, strict=True):
            found[:, :, sensor, place] = 1.0
            found[:, :, sensor, place + 1] = since
        return found

    def transitions(self, segments: Segments) -> Array:
        """Return what each segment hands to the next, ``(segment, component, component)``."""
        found = np.tile(np.eye(self.count), (segments.count, 1, 1))
        for place in self._values:
            found[:, place, place + 1] = segments.times[:, -1] - segments.times[:, 0]
        return found

    def log_prior_variance(self, segments: Segments) -> float:
        """Return ``ln det`` of the prior covariance of all components over the record."""
        begins, steps = len(segments.begins), int(segments.follows.sum())
        logs = begins * np.log(self.first) + steps * np.log(self.increment)
        return 2 * float(logs.sum())

    @property
    def _values(self) -> range:
        """Components that are values of sensor errors."""
        return range(len(self.forced), self.count, 2)


NO_WALKS = Walks((), (), np.zeros(0), np.zeros(0))
