"""The time steps of an observer that follows a stream.

Forecasts take most of the time of an observer. Their time step may be longer than that of the
simulator, as long as this changes a forecast far less than the noise of a reading does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.march import March
from dashred.inference.observer.perturbation_march import is_stable_for_long
from dashred.inference.streaming.readout import Readout

Array = NDArray[np.float64]

# Numbers of steps in an interval between samples that are tried, in turn, and on how many states.
STEPS, STATES = (1, 2, 3, 4, 6, 8), 8
# Largest change of a field, as a share of its std, per change of a reading in σ.
FIELD_SHARE = 0.02


def with_longest_step(
    march: March,
    readout: Readout,
    noise: Array,
    states: Array,
    interval: float,
    span: float,
    tolerance: float,
) -> March:
    """Return the flow with the longest time step that hardly changes a forecast.

    Args:
        march: the simulator from sample to sample.
        readout: of quantities, of which the first are the sensors.
        noise: σ of each sensor, ``(sensor,)``.
        states: that the system may be in, ``(state, field*point)``.
        interval: time between two samples.
        span: length of the forecast.
        tolerance: largest change of a reading, as root mean square in σ.
    """
    # Inputs that come in are not known for other times yet.
    if not march.takes_other_steps or march.has_inputs:
        return march
    tried, end = states[:STATES], march.begin + span
    exact = march(tried, march.begin, span)
    size = _by_field(states - states.mean(axis=0), march)
    for count in STEPS:
        coarse = march.with_step(interval / count)
        if coarse.system.dt <= march.system.dt:
            break
        change = coarse(tried, march.begin, span) - exact
        readings = (readout(exact + change, end) - readout(exact, end))[:, : len(noise)]
        # These are also false for runs that have blown up.
        is_accurate = np.sqrt(np.square(readings).mean(axis=0)) <= tolerance * noise
        limits = FIELD_SHARE * tolerance * size
        is_accurate &= (_by_field(change, march) <= limits).all()
        if is_accurate.all() and is_stable_for_long(coarse, states, march.begin, interval):
            return coarse
    return march


def _by_field(values: Array, march: March) -> Array:
    """Return the root mean square of each field, ``(field,)``."""
    fields = len(march.system.fields)
    found: Array = np.sqrt(np.square(values).reshape(len(values), fields, -1).mean(axis=(0, 2)))
    return found
