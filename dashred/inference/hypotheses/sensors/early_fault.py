"""Sensor faults that explain a record without any law, found over its first part."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from dashred.core.progress import Report
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.hypotheses.first_part import MAX_CHI2, MIN_EXCESS, FirstPart, follows
from dashred.inference.hypotheses.follow_to_end import STEPS, TOLERANCE, follow_to_end
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, by_score
from dashred.inference.hypotheses.sensors.fault_fits import fit_sensor_hypotheses
from dashred.inference.sensor_faults.fault import count_sensors

# With fewer sensors it cannot be told which of them is wrong.
MIN_SENSORS = 3


def find_early_fault(
    null: LeastSquaresProblem, part: FirstPart, report: Report
) -> HypothesisFit | None:
    """Return the uncorrected simulator, fitted without the faulty sensors, if they explain all.

    The faults of the sensors are found over the first part. The simulator alone then has to follow
    the other sensors to the end of the record.

    Args:
        null: F of the start alone over the whole record.
        part: the first part in which something is missing.
        report: progress.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    if count_sensors(null) < MIN_SENSORS:
        return None
    fitted = minimise(part.null, part.phi, STEPS, TOLERANCE)
    law = build_law(part.null, fitted, fitted.cost)
    # Faults that leave more than noise are not searched.
    bound = MAX_CHI2 * part.null.noise.count + MIN_EXCESS
    found = fit_sensor_hypotheses(HypothesisFit(law, part.null, fitted.phi), bound)
    if not found:
        return None
    best = min(found, key=by_score)
    report(part.samples / len(null.recorded), f"{best.law}, χ²/n {best.law.chi2:.2f}")
    if not follows(best.objective, best.law.chi2 * best.objective.noise.count):
        return None
    sound = without_sensors(null, (fault.sensor for fault in best.faults))
    last = follow_to_end(sound, best.phi[: null.modes], part.samples, str(best.law), report)
    if last is None:
        return None
    return HypothesisFit(build_law(sound, last, last.cost), sound, last.phi)


def without_sensors(problem: LeastSquaresProblem, columns: Iterable[int]) -> LeastSquaresProblem:
    """Return F without the samples of some sensors, in all episodes."""
    seen = problem.noise.available.clone()
    for column in columns:
        seen[:, problem.forward_model.sensors.columns_of(column)] = False
    return replace(problem, noise=replace(problem.noise, available=seen))
