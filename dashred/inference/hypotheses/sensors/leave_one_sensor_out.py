"""A sensor fault in addition to a model error: the sensor is detected and then excluded.

If a law is missing too, no fit of the simulator can identify the fault. A free forcing explains the
readings of the other sensors, whatever the law is. Laws are then searched without the faulty
sensor, and its fault is estimated from the residual of the law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.inference.fit.law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import ExcludedSensor, HypothesisFit, refit
from dashred.inference.hypotheses.sensors.fault_in_units import fault_in_units
from dashred.inference.hypotheses.sensors.faults import Fault, predict_faults
from dashred.inference.hypotheses.sensors.suspected_faults import find_suspected_faults

# Smallest gain of a fault, in units of the mean misfit of the forcing. A forcing is coarse, so its
# residual at a sound sensor may look like a fault with a smaller gain.
MIN_MISFITS = 40.0
# With fewer sensors none is excluded: it cannot be told which of them is wrong.
MIN_SENSORS = 3
STEPS, TOLERANCE = 6, 1e-3


def find_sensor_fault(forcing: FreeForcing) -> Fault | None:
    """Return the sensor fault that a free forcing cannot explain; None if there is none."""
    objective, phi = forcing.objective, forcing.phi
    sensors = objective.forward_model.sensors.sensors
    seen = objective.noise.available.any(dim=0).tolist()
    if len({s.name for s, is_seen in zip(sensors, seen, strict=True) if is_seen}) < MIN_SENSORS:
        return None
    faults = find_suspected_faults(objective, forcing.normal)
    predictions = predict_faults(objective, phi, forcing.normal, faults)
    best, fault = min(predictions, key=lambda pair: pair[0].score)
    misfit = max(1.0, forcing.cost / objective.noise.count)
    return fault if best.score < forcing.cost - MIN_MISFITS * misfit else None


def refit_forcing_without_sensor(forcing: FreeForcing, sensor: int) -> FreeForcing:
    """Refit a free forcing with the same levels, without one of the sensors."""
    noise, sensors = forcing.objective.noise, forcing.objective.forward_model.sensors
    seen = noise.available.clone()
    seen[:, sensors.columns_of(sensor)] = False
    problem = replace(forcing.objective, noise=replace(noise, available=seen))
    fitted = minimise(problem, forcing.phi, STEPS, TOLERANCE)
    normal = problem.linearise(fitted.phi, fitted.readings)
    return replace(forcing, objective=problem, phi=fitted.phi, cost=fitted.cost, normal=normal)


def refit_simulator_without_sensor(
    null: HypothesisFit, forcing: FreeForcing, noise: NoiseModel
) -> HypothesisFit:
    """Refit the uncorrected simulator without the sensor that a free forcing excludes.

    Args:
        null: the fit to all sensors, which the faulty sensor may have misled.
        forcing: the forcing from whose initial state the fit begins.
        noise: the noise under the forcing, with the samples that the forcing used.
    """
    problem = replace(null.objective, noise=noise)
    fitted = minimise(problem, forcing.phi[: problem.modes], STEPS, TOLERANCE)
    return HypothesisFit(build_law(problem, fitted, fitted.cost), problem, fitted.phi)


def add_fault(fit: HypothesisFit, sensor: int) -> HypothesisFit:
    """Return a hypothesis that was fitted without a sensor, with the fault of this sensor added."""
    return _add_likeliest_fault(fit, sensor)[0]


def _add_likeliest_fault(fit: HypothesisFit, sensor: int) -> tuple[HypothesisFit, ExcludedSensor]:
    full_problem, phi = with_all_samples(fit.objective), fit.phi
    normal = full_problem.linearise(phi)
    columns = full_problem.forward_model.sensors.columns_of(sensor)
    suspected = find_suspected_faults(full_problem, normal)
    faults = [fault for fault in suspected if fault.sensor in columns]
    predictions = predict_faults(full_problem, phi, normal, faults)
    best, fault = min(predictions, key=lambda pair: pair[0].score)
    [cost], _ = fit.objective.values(phi[None])
    score = fit.law.score - float(cost) + best.score
    in_units = fault_in_units(full_problem, fault, best.parameters, best.stds)
    law = replace(fit.law, score=score, fault=in_units)
    excluded_sensor = ExcludedSensor(fit, sensor, normal.minimum() - best.score)
    return replace(fit, law=law, excluded_sensor=excluded_sensor), excluded_sensor


def add_fault_or_refit(laws: Sequence[HypothesisFit], sensor: int) -> list[HypothesisFit]:
    """Add the sensor's fault to laws fitted without it, or refit them to all sensors.

    The fault is added if it improves the best law. Otherwise the sensor is taken to be sound.
    """
    if not laws:
        return []
    pairs = [_add_likeliest_fault(law, sensor) for law in laws]
    best_index = min(range(len(laws)), key=lambda j: pairs[j][0].law.score)
    best, excluded_sensor = pairs[best_index]
    best_law = laws[best_index]
    refit_best = _refit_with_all_sensors(best_law)
    if excluded_sensor.gain <= 0 or refit_best.law.score < best.law.score:
        return [refit_best if law is best_law else _refit_with_all_sensors(law) for law in laws]
    return [*(with_fault for with_fault, _ in pairs), refit_best]


def _refit_with_all_sensors(fit: HypothesisFit) -> HypothesisFit:
    """Refit a hypothesis that was fitted without a sensor to all sensors."""
    return refit(fit, with_all_samples(fit.objective))


def with_all_samples(objective: LeastSquaresProblem) -> LeastSquaresProblem:
    """Return F of all recorded samples."""
    return replace(objective, noise=replace(objective.noise, available=~objective.recorded.isnan()))
