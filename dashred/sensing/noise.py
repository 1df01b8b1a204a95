"""How noisy each sensor is, where nobody said so."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dashred.errors import InputError
from dashred.sensing.recording import Recording

# Third differences of white noise of variance σ² have variance (1 + 9 + 9 + 1) σ².
SPREAD = math.sqrt(20.0)
# Median absolute value of a standard normal variable.
MEDIAN = 0.6744897501960817


def noise_std(recording: Recording) -> NDArray[np.float64]:
    """Noise of each sensor of a uniformly sampled recording, shape (sensor,), in its own unit.

    The stated std, or σ = median |Δ³y| / (0.6745 √20): third differences remove whatever is
    quadratic over four samples, and the median ignores the few that a front or a spike leaves.
    A sensor in which nothing changes (stuck) gets the median of the others that read the same.

    Raises:
        InputError: if nothing can be estimated for a sensor, not even from the others.
    """
    found = np.array(
        [
            _estimated(values) if sensor.std is None else sensor.std
            for sensor, values in zip(recording.sensors, recording.values.T, strict=True)
        ],
        dtype=np.float64,
    )
    reads = np.array([sensor.reads for sensor in recording.sensors])
    for index in np.flatnonzero(found == 0.0):
        others = found[(reads == reads[index]) & (found > 0.0)]
        if not others.size:
            problem = f"the noise of sensor {recording.names[index]!r} cannot be estimated"
            hint = "it is constant or has too few values: state its std in the table of sensors"
            raise InputError(problem, hint=hint)
        found[index] = np.median(others)
    return found


def _estimated(values: NDArray[np.float64]) -> float:
    rough = np.diff(values, n=3)
    rough = np.abs(rough[np.isfinite(rough)])
    if not rough.size:
        return 0.0
    # Coarsely rounded values often repeat: the median is then zero, the mean square is not.
    typical = float(np.median(rough)) / MEDIAN or float(np.sqrt(np.mean(rough**2)))
    return typical / SPREAD
