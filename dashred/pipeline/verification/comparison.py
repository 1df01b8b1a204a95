"""Comparison of the told model with the simulator's own best start, on held-out data.

The squared errors of the two runs at the same samples are subtracted, as in the test of equal
accuracy of Diebold and Mariano (*Journal of Business & Economic Statistics* 13, 1995). Neighbouring
samples are correlated, so the error of the mean difference is computed from means over blocks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import t as student

from dashred.core.findings.fit_schema import Comparison, HeldOutData
from dashred.pipeline.verification.held_out import HeldOutPredictions, pooled_rmse
from dashred.pipeline.verification.predictions import Array, Predictions

BEFORE, AFTER = "simulation_refit", "corrected"
# Number of blocks of an episode, and of samples in a block, at least.
BLOCKS, MIN_SAMPLES = 8, 3
# The two-sided confidence level of the error bar.
LEVEL = 0.99
# Errors in standard deviations count as this at most, so that no single sample decides.
MAX_ERROR = 10.0
# Error of the mean of the readings, in their standard deviations. If the system is chaotic, runs
# are compared until their errors are as large.
SATURATED = 1.0


def compare_held_out(predictions: HeldOutPredictions) -> list[Comparison]:
    """Compare the corrected simulator with the simulator from its own best start.

    Sensors with a fault are corrected for both, so that only the law and the start are compared.
    Data at which the runs of a chaotic system are lost within a few samples are left out.
    """
    found = []
    for data, parts in predictions.items():
        both = [
            part.with_same_sensors()
            for part in parts
            if {BEFORE, AFTER} <= part.read.keys() and not part.is_lost
        ]
        compared = [part for part in map(_predictable, both) if _is_comparable(part)]
        if compared:
            found.append(_compare(data, both, compared))
    return found


def misfits_at_sensors(
    parts: Sequence[Predictions], noise: Mapping[str, float]
) -> dict[str, float]:
    """Return the RMSE of the corrected simulator at each test sensor, in σ of the noise.

    Of a chaotic system only the samples before the runs are lost are used. A sensor without
    readings is left out.

    Args:
        parts: predictions for the test sensors, by episode.
        noise: σ of each sensor, in the order of the readings.
    """
    compared = [_predictable(part) for part in parts if {BEFORE, AFTER} <= part.read.keys()]
    if not compared:
        return {}
    recorded = np.concatenate([part.recorded for part in compared])
    errors = np.concatenate([part.errors(AFTER) * part.scale for part in compared])
    # The errors are NaN where a reading is missing, and after a blow-up.
    squares = np.nan_to_num(np.square(errors), nan=np.inf)
    return {
        name: float(np.sqrt(squares[seen, column].mean()) / std)
        for column, (name, std) in enumerate(noise.items())
        if (seen := ~np.isnan(recorded[:, column])).any()
    }


def _compare(
    data: HeldOutData, parts: Sequence[Predictions], compared: Sequence[Predictions]
) -> Comparison:
    """Compare the errors over the predictable samples of all episodes."""
    differences = [_difference(part) for part in compared]
    mean = float(np.mean(np.concatenate(differences)))
    error = _error_of_mean(differences)
    is_cut = sum(len(part.times) for part in compared) < sum(len(part.times) for part in parts)
    horizon = max(float(part.times[-1] - part.times[0]) for part in compared)
    before, after = (pooled_rmse(compared, method) for method in (BEFORE, AFTER))
    # Of few samples no error bar is known, but a run that blows up needs none.
    blows_up = math.isinf(after) and math.isfinite(before)
    return Comparison(
        data=data,
        before=before,
        after=after,
        difference=mean,
        error=error,
        samples=sum(map(len, differences)),
        horizon=horizon if is_cut else None,
        worse=blows_up or (error is not None and mean > error),
    )


def _difference(part: Predictions) -> Array:
    """Return ``e_after² − e_before²`` averaged over the sensors, at the times with readings."""
    seen = ~np.isnan(part.recorded)
    after, before = (_squares(part, method) for method in (AFTER, BEFORE))
    times = seen.any(axis=1)
    total: Array = np.where(seen, after - before, 0.0).sum(axis=1)
    return total[times] / seen.sum(axis=1)[times]


def _squares(part: Predictions, method: str) -> Array:
    errors = np.nan_to_num(part.errors(method), nan=MAX_ERROR, posinf=MAX_ERROR, neginf=MAX_ERROR)
    return np.square(np.clip(errors, -MAX_ERROR, MAX_ERROR))


def _error_of_mean(differences: Sequence[Array]) -> float | None:
    """Return the half width of the interval of the mean; None of too few samples.

    The variance of a block's mean is estimated from the differences of neighbouring blocks (von
    Neumann, *Annals of Mathematical Statistics* 12, 1941), because a forecast error grows with
    time, and such a trend is no random error.
    """
    steps, blocks = [], 0
    for difference in differences:
        count = min(BLOCKS, len(difference) // MIN_SAMPLES)
        if count < 2:
            continue
        means = [block.mean() for block in np.array_split(difference, count)]
        steps.append(np.diff(means))
        blocks += count
    if not steps:
        return None
    changes = np.concatenate(steps)
    variance = float(np.mean(np.square(changes))) / 2
    # Neighbouring differences share a block, which reduces the degrees of freedom.
    degrees_of_freedom = 2 * len(changes) ** 2 / (3 * len(changes) - 1)
    quantile = float(student.ppf((1 + LEVEL) / 2, degrees_of_freedom))
    return quantile * math.sqrt(variance / blocks)


def _is_comparable(part: Predictions) -> bool:
    """Return whether there are readings, and enough of them if the runs are lost after these."""
    is_long = part.is_predictable or len(part.times) >= MIN_SAMPLES
    return is_long and bool(np.isfinite(part.recorded).any())


def _predictable(part: Predictions) -> Predictions:
    """Return the samples until both runs are lost; all samples of a predictable system."""
    if part.is_predictable:
        return part
    lost = [_first_lost(part, method) for method in (BEFORE, AFTER)]
    return part.truncate(max(lost))


def _first_lost(part: Predictions, method: str) -> int:
    """Return the index of the first sample with an error as large as the spread of the readings."""
    seen = ~np.isnan(part.recorded)
    squares = np.where(seen, _squares(part, method), 0.0).sum(axis=1)
    lost = squares >= SATURATED**2 * np.maximum(seen.sum(axis=1), 1)
    return int(lost.argmax()) if lost.any() else len(lost)
