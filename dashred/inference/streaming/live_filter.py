"""A causal ensemble filter: one step for every sample of a stream.

It is the ensemble square-root filter of Whitaker & Hamill (2002) with localisation. Between samples
each member runs through the simulator. Multiplicative inflation, and a small random part of the
anomalies of the climate, keep the spread from collapsing in a long stream.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.data.sensors import Sensor
from dashred.inference.initial_state.ensemble_filter import (
    SMALLEST_SHARE,
    FilterLostError,
    bounded_members,
)
from dashred.inference.initial_state.serial_analysis import analyse, inflate
from dashred.inference.observer.localisation import sensor_tapers
from dashred.inference.observer.march import March, points_of
from dashred.inference.observer.random_differences import random_differences
from dashred.inference.streaming.live_estimator import FAR, MIXING, Analysed, LiveSettings
from dashred.inference.streaming.readout import Readout

Array = NDArray[np.float64]


# Radii that are tried, as shares of the shortest axis.
RADII = (0.25, 0.125, 0.0625)
# Without a random part and inflation, the filter would no longer listen after a long time.
ADDITIVE, INFLATION = (1e-3, 1e-2), (1.005, 1.02, 1.05)


class LiveFilter:
    """The filter with its members at the time of the last sample.

    Attributes:
        time: of the last sample.
        members: states of the members, ``(member, field*point)``, at the points of the axes without
            mirror images.
    """

    def __init__(
        self,
        march: March,
        sensors: Sequence[Sensor],
        places: Sequence[Sensor],
        noise: Array,
        climate: Array,
        members: int,
        settings: LiveSettings,
        seed: int,
    ) -> None:
        """Draw the first members from the climate.

        Args:
            march: the simulator from sample to sample.
            sensors: sensors that are assimilated.
            places: further quantities that are estimated.
            noise: σ of each sensor.
            climate: states that the system may be in, ``(state, field*point)``.
            members: number of members.
            settings: localisation and inflation.
            seed: of the random numbers.
        """
        self.march, self.system, self.settings = march, march.system, settings
        self.sensors, self.places = tuple(sensors), tuple(places)
        self._noise, self._climate, self._count = noise, climate, members
        self._mean, self._range = climate.mean(axis=0), np.ptp(climate, axis=0).max()
        quantities = (*self.sensors, *self.places)
        self.quantities = Readout(march, self.system, quantities)
        self._tapers = sensor_tapers(self.system, self.sensors, quantities, settings.radius)
        self._shape = points_of(self.system)
        self._rng = np.random.default_rng(seed)
        self.time = math.nan
        self.members = np.empty(0)
        self.begin()

    def copy(self) -> LiveFilter:
        """Return an independent copy in the same state."""
        other = copy.copy(self)
        other.members = self.members.copy()
        other._rng = copy.deepcopy(self._rng)
        return other

    def with_settings(self, settings: LiveSettings) -> LiveFilter:
        """Return the filter with other settings, and with first members."""
        other = self.copy()
        other.settings = settings
        quantities = (*self.sensors, *self.places)
        other._tapers = sensor_tapers(self.system, self.sensors, quantities, settings.radius)
        other.begin()
        return other

    def begin(self) -> None:
        """Draw the members from the climate."""
        states, count = self._climate, self._count
        one = states[self._rng.choice(len(states), count, replace=len(states) < count)]
        self.members, self.time = one + MIXING * self._differences(), math.nan

    def step(self, time: float, span: float, values: Array, limits: Array) -> Analysed:
        """Run the members to a sample and assimilate it; see :class:`.LiveEstimator`.

        Raises:
            FilterLostError: more than half of the members blow up.
        """
        if not math.isnan(self.time):
            self.members = self.march(self.members, time - span, span, known=time)
            self._replace_lost(time)
            inflate(self.members, self.settings.inflation, self._random_part())
        self.time = time
        quantities = self.quantities(self.members, time)
        joint = np.concatenate([quantities, self.members], axis=1)
        found = analyse(joint, values, self._noise, self._tapers, limits)
        count = quantities.shape[1]
        self.members = joint[:, count:].copy()
        known = joint[:, :count]
        return Analysed(known.mean(axis=0), known.std(axis=0, ddof=1), *found)

    def ahead(self, span: float) -> Array:
        """Return the quantities that are expected after a time, ``(quantity,)``.

        They are those of the run of the simulator from the mean of the members. Inputs keep their
        last values.
        """
        mean = self.members.mean(axis=0, keepdims=True)
        later = self.march(mean, self.time, span, known=self.time)
        return self.quantities(later, self.time + span)[0]

    @property
    def description(self) -> str:
        """The filter and its settings in words."""
        known = self.settings
        radius = "" if math.isinf(known.radius) else f"localisation radius {known.radius:.3g}, "
        return (
            f"filter: {self._count} members, {radius}inflation {known.inflation:g}, additive part "
            f"{known.additive:g}"
        )

    @property
    def mean(self) -> Array:
        """Mean state of the members at the points of the axes, ``(field, *point)``."""
        return self.members.mean(axis=0).reshape(len(self.system.fields), *self._shape)

    @property
    def changes(self) -> Sequence[tuple[str, Sequence[float]]]:
        """Settings and the values of each that may be tried, in order."""
        axes = self.system.axes
        shortest = min((axis.length for axis in axes), default=math.inf)
        radii = [math.inf, *(share * shortest for share in RADII)] if axes else [math.inf]
        return [("radius", radii), ("additive", ADDITIVE), ("inflation", INFLATION)]

    def _random_part(self) -> Array:
        """Return the random part that each member gets, ``(member, field*point)``."""
        return self.settings.additive / math.sqrt(2) * self._differences()

    def _differences(self) -> Array:
        """Return differences of random states of the climate, ``(member, field*point)``."""
        return random_differences(self._climate, self._count, self._rng)

    def _replace_lost(self, time: float) -> None:
        """Put copies of other members in place of those that blow up."""
        farthest = np.abs(self.members - self._mean).max()
        if farthest <= FAR * self._range:
            return
        bounded = bounded_members(torch.from_numpy(self.members)).numpy()
        kept = np.flatnonzero(bounded)
        if len(kept) < max(2, SMALLEST_SHARE * self._count) or not (
            np.abs(self.members[kept].mean(axis=0) - self._mean).max() <= FAR * self._range
        ):
            raise FilterLostError(f"the members have blown up at t = {time:g}")
        lost = np.flatnonzero(~bounded)
        self.members[lost] = self.members[self._rng.choice(kept, len(lost))]
