"""What a live estimator does: one step for every sample of a stream."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from dashred.data.sensors import Sensor

Array = NDArray[np.float64]

# A first state is one of the climate, changed by this share of a difference of two others.
MIXING = 0.2
# A state farther from the mean of the climate than this multiple of its range may be blowing up.
FAR = 10.0


@dataclass(frozen=True)
class LiveSettings:
    """Settings of an estimator.

    Attributes:
        radius: Gaspari–Cohn radius about a sensor, in the unit of the axes; infinite for none. An
            observer has none.
        inflation: factor on the anomalies of the forecast before each analysis. An observer has
            none.
        additive: standard deviation of the random part that each simulation gets before each
            analysis, as a share of that of the climate.
    """

    radius: float = math.inf
    inflation: float = 1.005
    additive: float = 1e-3


class Analysed(NamedTuple):
    """What the estimator knows after a sample.

    Attributes:
        estimate: mean of each quantity, ``(quantity,)``.
        spread: standard deviation of each quantity, ``(quantity,)``.
        innovation: reading minus its forecast, ``(sensor,)``; NaN without a reading.
        innovation_std: expected standard deviation of the innovation, ``(sensor,)``.
        serial: innovations given the earlier readings of the sample, in their own standard
            deviations, ``(sensor,)``; see :func:`.serial_analysis.analyse`.
        density: logarithm of the density of the readings, without its constant.
    """

    estimate: Array
    spread: Array
    innovation: Array
    innovation_std: Array
    serial: Array
    density: float


class LiveEstimator(Protocol):
    """An ensemble filter or an observer."""

    settings: LiveSettings
    sensors: tuple[Sensor, ...]
    places: tuple[Sensor, ...]
    time: float

    @property
    def changes(self) -> Sequence[tuple[str, Sequence[float]]]:
        """Settings and the values of each that may be tried, in order."""

    @property
    def description(self) -> str:
        """The estimator and its settings in words."""

    @property
    def mean(self) -> Array:
        """The estimated state at the points of the axes, ``(field, *point)``."""

    def copy(self) -> Self:
        """Return an independent copy in the same state."""

    def with_settings(self, settings: LiveSettings) -> Self:
        """Return the estimator with other settings, before the first sample."""

    def begin(self) -> None:
        """Forget all samples; the state may be any of the climate."""

    def step(self, time: float, span: float, values: Array, limits: Array) -> Analysed:
        """Go to a sample and assimilate it.

        Args:
            time: of the sample.
            span: time since the last sample; it is ignored at the first one.
            values: readings of the sensors, ``(sensor,)``; NaN where missing.
            limits: largest innovation of each sensor that is assimilated, in standard deviations,
                ``(sensor,)``; 0 leaves a sensor out.

        Raises:
            FilterLostError: the estimate has blown up.
        """

    def quantities(self, states: Array, time: float) -> Array:
        """Return the quantities of states ``(state, field*point)``: ``(state, quantity)``."""

    def ahead(self, span: float) -> Array:
        """Return the quantities that are expected after a time, ``(quantity,)``."""
