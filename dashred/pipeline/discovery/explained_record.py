"""Whether a hypothesis explains the record."""

from __future__ import annotations

from dataclasses import replace

from dashred.inference.fit.law import Law
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.comparison.comparison import Comparison
from dashred.inference.hypotheses.result import MAX_EXPLAINED_CHI2, MIN_FORCING_GAIN
from dashred.pipeline.discovery.least_squares import fit_noise
from dashred.pipeline.problem import Problem

# Estimated noise of more than this many times the stated noise is attributed to another cause.
MAX_NOISE_RATIO = 1.3
# Share of the record in which an error of the start is forgotten.
FORGOTTEN = 0.1


def is_noise_inflated(problem: Problem, noise: NoiseModel, *, is_whole: bool = True) -> bool:
    """Return whether the estimated noise is far above the noise that the recording states.

    Args:
        problem: the recording.
        noise: estimated from the residuals of a law.
        is_whole: whether the law follows the whole record. Otherwise its residuals are no noise,
            and the noise that is visible in the traces is used where none is stated.
    """
    is_stated = all(sensor.std is not None for sensor in problem.split.fit.sensors)
    ratio = float((noise.std / fit_noise(problem).std).median())
    return (is_stated or not is_whole) and ratio > MAX_NOISE_RATIO


def is_record_explained(problem: Problem, comparison: Comparison) -> bool:
    """Return whether the best hypothesis, or a free forcing, explains the whole record.

    This is used if the horizon did not reach the end of the record. The residuals must be noise. In
    addition the hypothesis must be a local law, a source, a sensor fault or another start, or a
    free forcing must not improve the fit. If no hypothesis explains the record, but a free forcing
    does, then the simulator lacks an effect that the library does not express. If the time sufficed
    for sensor faults only, no forcing was fitted, and the noise is that from before the comparison.
    """
    best = comparison.laws[0]
    has_other_cause = (
        best.window is not None
        or best.source is not None
        or bool(best.faults)
        or best.has_other_start
    )
    if comparison.is_cut_short:
        return has_other_cause and best.chi2 < MAX_EXPLAINED_CHI2
    if comparison.forcing_gain > MIN_FORCING_GAIN and comparison.forcing_map is not None:
        return not is_noise_inflated(problem, comparison.forced_noise)
    if is_noise_inflated(problem, comparison.noise) and not is_start_explained(problem, best):
        return False
    return has_other_cause or comparison.forcing_gain <= MIN_FORCING_GAIN


def is_start_explained(problem: Problem, law: Law) -> bool:
    """Return whether another start explains the record after its first samples.

    The modes of a start cannot express every field. The rest is visible in the first samples, and a
    dissipative system forgets it.
    """
    if law.start_prior_factor <= 1:
        return False
    noise = fit_noise(problem)
    later = noise.available & ~law.residuals.isnan()
    later[: round(FORGOTTEN * len(later))] = False
    residuals = replace(noise, available=later).whiten(law.residuals)
    return float(residuals.square().sum() / later.sum()) < MAX_NOISE_RATIO**2
