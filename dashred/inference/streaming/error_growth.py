"""How fast a small error of the state grows along the climate of a simulator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.march import March

Array = NDArray[np.float64]

# Number of states, and size of the error as a share of the range of the climate.
STATES, SMALL = 16, 1e-6


def error_growth(march: March, climate: Array, span: float, samples: int, seed: int) -> float:
    """Return the mean logarithm of the growth of a small error over so many samples.

    It is made small again after each sample (Benettin et al., Meccanica 15, 1980). Half of the
    samples are not counted, while the error turns to the direction in which it grows.

    Args:
        march: the simulator.
        climate: states that the system may be in, ``(state, field*point)``.
        span: time between samples.
        samples: number of samples.
        seed: of the random numbers.
    """
    rng = np.random.default_rng(seed)
    states = climate[rng.integers(len(climate), size=STATES)]
    small = SMALL * max(float(np.ptp(climate, axis=0).max()), np.finfo(np.float64).tiny)
    error = rng.standard_normal(states.shape)
    error *= small / np.linalg.norm(error, axis=1, keepdims=True)
    logs = []
    for sample in range(samples):
        moved = march(np.concatenate([states, states + error]), march.begin + sample * span, span)
        states, error = moved[:STATES], moved[STATES:] - moved[:STATES]
        size = np.linalg.norm(error, axis=1, keepdims=True)
        growth = np.log(np.maximum(size, np.finfo(np.float64).tiny) / small)
        logs.append(growth[np.isfinite(growth)].mean())
        error *= small / np.maximum(size, np.finfo(np.float64).tiny)
    return float(samples * np.mean(logs[samples // 2 :]))
