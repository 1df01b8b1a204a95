"""The time steps of an observer that follows a stream.

Forecasts take most of the time of an observer. Their time step may be longer than that of the
simulator, as long as this changes a forecast far less than the noise of a reading does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.march import March
from dashred.inference.observer.perturbation_march import (
    STEPS,
    is_stable_for_long,
    mean_squares,
)
from dashred.inference.streaming.readout import Readout

Array = NDArray[np.float64]

# Numbers of states on which steps are tried, and near which errors must not grow.
STATES, STABLE = 8, 3
# Limit of the change of a field, in its standard deviations, for each σ of the limit of a reading.
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
        states: that the system may be in, in order of time, ``(state, field*point)``.
        interval: time between two samples.
        span: length of the forecast.
        tolerance: largest change of a reading, as root mean square in σ.
    """
    # What depends on time, or on inputs that come in, may be different later.
    if not march.takes_other_steps or march.has_inputs or march.system.reads_time():
        return march
    tried, end = _spread(states, STATES), march.begin + span
    exact = march(tried, march.begin, span)
    if not np.isfinite(exact).all():
        return march
    fields, beside = len(march.system.fields), _spread(states, STABLE)
    size = np.sqrt(mean_squares(states - states.mean(axis=0), fields))
    for count in STEPS:
        coarse = march.with_step(interval / count)
        if coarse.system.dt <= march.system.dt:
            break
        rough = coarse(tried, march.begin, span)
        # This is also true for runs that have blown up.
        if not np.abs(rough - exact).max() <= np.ptp(states):
            continue
        change, limits = rough - exact, FIELD_SHARE * tolerance * size
        readings = (readout(rough, end) - readout(exact, end))[:, : len(noise)]
        of_readings = np.sqrt(np.square(readings).mean(axis=0))
        is_accurate = (of_readings <= tolerance * noise).all()
        is_accurate &= (np.sqrt(mean_squares(change, fields)) <= limits).all()
        if is_accurate and is_stable_for_long(coarse, beside, march.begin, interval):
            return coarse
    return march


def _spread(states: Array, count: int) -> Array:
    """Return some states from all parts, ``(count, field*point)``."""
    return states[np.linspace(0, len(states) - 1, count).astype(np.intp)]
