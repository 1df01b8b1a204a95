"""A causal observer: one step of few runs of the simulator for every sample of a stream.

See docs/method.md#observer. The gains come from simulations that start in the climate. They
depend on the number of samples since the beginning, and are steady later. Where it pays,
perturbations about the estimate make them follow the state.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.data.sensors import Sensor
from dashred.inference.initial_state.ensemble_filter import FilterLostError
from dashred.inference.observer.covariances import Update
from dashred.inference.observer.estimate import Estimate
from dashred.inference.observer.localisation import radius_for, sensor_tapers
from dashred.inference.observer.march import March, points_of
from dashred.inference.observer.perturbation_march import PerturbationMarch, perturbation_step
from dashred.inference.observer.random_differences import random_differences
from dashred.inference.streaming.forecast_step import with_longest_step
from dashred.inference.streaming.live_estimator import FAR, Analysed, LiveSettings
from dashred.inference.streaming.live_gains import SIMULATIONS, LiveGains, learn_gains
from dashred.inference.streaming.readout import Readout

Array = NDArray[np.float64]

# Largest changes of a reading by longer time steps, in σ: in the forecast of the next sample, from
# which the estimate comes, and in other forecasts.
ESTIMATE_TOLERANCE, FORECAST_TOLERANCE = 0.01, 0.05
# Errors of the simulator in an interval between samples that are tried. With none, the observer
# would no longer listen after a long time.
MODEL_ERRORS = (1e-3, 1e-2)


class LiveObserver:
    """The observer with its state at the time of the last sample.

    Attributes:
        time: of the last sample.
        estimate: of the state, at the points of the axes without mirror images.
    """

    def __init__(
        self,
        march: March,
        sensors: Sequence[Sensor],
        places: Sequence[Sensor],
        noise: Array,
        climate: Array,
        span: float,
        settings: LiveSettings,
        seed: int,
    ) -> None:
        """Learn the gains and begin at the mean of the climate.

        Args:
            march: the simulator from sample to sample.
            sensors: sensors that are assimilated.
            places: further quantities that are estimated.
            noise: σ of each sensor.
            climate: states that the system may be in, ``(state, field*point)``.
            span: time between two samples of the stream.
            settings: of which the observer has the additive part.
            seed: of the random numbers.
        """
        self.march, self.system, self.settings = march, march.system, settings
        self.sensors, self.places = tuple(sensors), tuple(places)
        self._noise, self._climate, self._span, self._seed = noise, climate, span, seed
        quantities = (*self.sensors, *self.places)
        self.quantities = Readout(march, self.system, quantities)
        radius = radius_for(self.system, len(self.sensors), SIMULATIONS)
        self._tapers = sensor_tapers(self.system, self.sensors, quantities, radius)
        self._shape = points_of(self.system)
        self._mean, self._range = climate.mean(axis=0), np.ptp(climate, axis=0).max()
        self._step = perturbation_step(march, climate, march.begin, span)
        self._flow, self._exact_flow = self._quick_flow(), PerturbationMarch(march, self._step)
        self._forecasts: dict[float, March] = {}
        self._gains = self._learnt()
        self.begin()

    def copy(self) -> LiveObserver:
        """Return an independent copy in the same state."""
        other = copy.copy(self)
        other.estimate = copy.copy(self.estimate)
        other._rng = copy.deepcopy(self._rng)
        return other

    def with_settings(self, settings: LiveSettings) -> LiveObserver:
        """Return the observer with other settings, before the first sample."""
        other = self.copy()
        if settings.additive != self.settings.additive:
            other.settings = settings
            other._gains = other._learnt()
        other.begin()
        return other

    def begin(self) -> None:
        """Begin at the mean of the climate."""
        self._rng = np.random.default_rng(self._seed)
        self.time, self._samples = math.nan, 0
        self.estimate = Estimate(self._mean[None], self._differences() / math.sqrt(2))
        self._later: tuple[float, Array] | None = None

    @property
    def changes(self) -> Sequence[tuple[str, Sequence[float]]]:
        """Settings and the values of each that may be tried, in order."""
        return [("additive", MODEL_ERRORS)]

    @property
    def description(self) -> str:
        """The observer and its settings in words."""
        followed = self._gains.perturbations
        by_state = f"{followed} perturbations, " if followed else ""
        return f"observer: {by_state}error of the simulator in a sample {self.settings.additive:g}"

    @property
    def mean(self) -> Array:
        """The estimate at the points of the axes, ``(field, *point)``."""
        return self.estimate.state[0].reshape(len(self.system.fields), *self._shape)

    def step(self, time: float, span: float, values: Array, limits: Array) -> Analysed:
        """Run to a sample and assimilate it; see :meth:`.live_estimator.LiveEstimator.step`.

        Raises:
            FilterLostError: the estimate has blown up.
        """
        estimate = self.estimate
        if not math.isnan(self.time):
            estimate.arrive(self._arrived(time, span), self._differences())
            self._check(time)
        self.time, self._later = time, None
        count = len(self._noise)
        read = self.quantities(estimate.states, time)
        known = estimate.covariances(self._gains.at(self._samples), read, self._tapers)
        self._samples += 1
        expected = known.of_innovations(self._noise, np.arange(count))
        std = np.sqrt(np.diag(expected))
        innovation = values - read[0, :count]
        # This is also false for a missing reading.
        used = np.flatnonzero(np.abs(innovation) < limits * std)
        serial, variance, density = np.full(count, np.nan), known.of_quantities.copy(), 0.0
        if len(used):
            # The factor of the readings that are used: innovations given the earlier ones.
            update = Update(expected[np.ix_(used, used)], known.across, used)
            factor = np.linalg.cholesky(update.of_innovations)
            serial[used] = np.linalg.solve(factor, innovation[used])
            estimate.correct(innovation[used], read[:, used], update)
            explained = np.linalg.solve(factor, known.between[used])
            variance -= np.square(explained).sum(axis=0)
            density = -float(np.square(serial[used]).sum() / 2 + np.log(np.diag(factor)).sum())
        analysed = self.quantities(estimate.state, time)[0]
        spread = np.sqrt(self._gains.factor * variance.clip(min=0))
        return Analysed(analysed, spread, innovation, std, serial, density)

    def ahead(self, span: float) -> Array:
        """Return the quantities that are expected after a time, ``(quantity,)``.

        Inputs keep their last values.
        """
        # The next sample needs the same forecast, with its perturbations.
        is_next = span == self._span and not self.march.has_inputs
        if is_next:
            self._later = span, self._forecast(span)
            later = self._later[1]
        else:
            later = self._forecast_flow(span)(self.estimate.state, self.time, span, self.time)
            # Long steps may blow up where those of the simulator do not.
            if not np.isfinite(later).all():
                later = self.march(self.estimate.state, self.time, span, self.time)
        return self.quantities(later[:1], self.time + span)[0]

    def _forecast_flow(self, span: float) -> March:
        """Return the flow of forecasts of a length; it is chosen once."""
        if span not in self._forecasts:
            self._forecasts[span] = self._with_longest_step(span, FORECAST_TOLERANCE)
        return self._forecasts[span]

    def _with_longest_step(self, span: float, tolerance: float) -> March:
        """Return the flow for forecasts of a length; see :func:`.with_longest_step`."""
        known = self.quantities, self._noise, self._climate
        return with_longest_step(self.march, *known, self._span, span, tolerance)

    def _arrived(self, time: float, span: float) -> Array:
        """Return all states at a sample; a forecast of that length was computed already."""
        if self._later is not None and self._later[0] == span:
            return self._later[1]
        return self._forecast(span, time)

    def _forecast(self, span: float, known: float | None = None) -> Array:
        """Return the forecasts of all states."""
        forecast = self._flow([self.estimate], self.time, span, known)[0]
        # This is also false for NaN.
        if np.abs(forecast - self._mean).max() <= FAR * self._range:
            return forecast
        return self._exact_flow([self.estimate], self.time, span, known)[0]

    def _quick_flow(self) -> PerturbationMarch:
        """Return the flow of the estimate with the longest steps, and of its perturbations."""
        own = self._with_longest_step(self._span, ESTIMATE_TOLERANCE)
        is_longer = self._step is not None and self._step > own.system.dt
        return PerturbationMarch(own, self._step if is_longer else None)

    def _learnt(self) -> LiveGains:
        return learn_gains(
            self.march,
            self.quantities,
            self._tapers,
            self._noise,
            self._climate,
            self._span,
            self.settings.additive,
            self._step,
            self._seed,
        )

    def _differences(self) -> Array:
        """Return differences of random states of the climate, ``(perturbation, field*point)``."""
        return random_differences(self._climate, self._gains.perturbations, self._rng)

    def _check(self, time: float) -> None:
        if not self.estimate.is_near(self._mean, FAR * self._range):
            raise FilterLostError(f"the estimate has blown up at t = {time:g}")
