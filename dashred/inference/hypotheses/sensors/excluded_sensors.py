"""Sensor faults in addition to a model error: the sensors are detected and then excluded.

If a law is missing too, no fit of the simulator can identify the faults. A free forcing explains
the readings of the other sensors, whatever the law is. Laws are then searched without the faulty
sensors, and their faults are estimated from the residual of the law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.core.findings.fault_kinds import FAULT_KINDS
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import ExcludedSensors, HypothesisFit, refit
from dashred.inference.hypotheses.sensors.early_fault import without_sensors
from dashred.inference.sensor_faults.fault import count_sensors
from dashred.inference.sensor_faults.fault_search import (
    FaultProblem,
    FaultSet,
    find_faults,
    largest_count,
)
from dashred.inference.sensor_faults.fault_table import fault_in_units
from dashred.inference.sensor_faults.neighbours import has_neighbours

# Smallest gain of a fault, in units of the mean misfit of the forcing. A forcing is coarse, so its
# residual at a sound sensor may look like a fault with a smaller gain.
MIN_MISFITS = 40.0
# With fewer sensors none is excluded: it cannot be told which of them is wrong.
MIN_SENSORS = 3
# A forcing and a wandering sensor must leave no larger χ²/n. A curve can imitate what a forcing is
# too coarse for, but then the forcing leaves more than noise at the other sensors, too.
MAX_CHI2 = 1.5
STEPS, TOLERANCE = 6, 1e-3


def find_faults_beside_forcing(forcing: FreeForcing) -> FaultSet:
    """Return the sensor faults that a free forcing cannot explain."""
    objective, normal = forcing.objective, forcing.normal
    problem = FaultProblem.at(objective, forcing.phi, normal)
    if count_sensors(objective) < MIN_SENSORS:
        return problem.faults
    margin = MIN_MISFITS * max(1.0, forcing.cost / objective.noise.count)
    columns, count = range(objective.recorded.shape[1]), largest_count(objective)
    found = find_faults(problem, columns, FAULT_KINDS, count, margin)
    block, system = objective.forward_model.sensors, objective.forward_model.simulator.system
    wandering = [block.sensors[f.sensor] for f in found.faults if f.kind == "wandering"]
    # A curve can also imitate a local law, at all sensors where it acts.
    is_local = has_neighbours(block.operator.sensors, wandering, system.axes)
    if not wandering or (found.cost < MAX_CHI2 * objective.noise.count and not is_local):
        return found
    others = FAULT_KINDS.keys() - {"wandering"}
    return find_faults(problem, columns, others, count, margin)


def refit_forcing_without_sensors(forcing: FreeForcing, faulty: Sequence[int]) -> FreeForcing:
    """Refit a free forcing with the same levels, without some of the sensors."""
    problem = without_sensors(forcing.objective, faulty)
    fitted = minimise(problem, forcing.phi, STEPS, TOLERANCE)
    normal = problem.linearise(fitted.phi, fitted.readings)
    return replace(forcing, objective=problem, phi=fitted.phi, cost=fitted.cost, normal=normal)


def refit_simulator_without_sensors(
    null: HypothesisFit, forcing: FreeForcing, noise: NoiseModel
) -> HypothesisFit:
    """Refit the uncorrected simulator without the sensors that a free forcing excludes.

    Args:
        null: the fit to all sensors, which the faulty sensors may have misled.
        forcing: the forcing from whose initial state the fit begins.
        noise: the noise under the forcing, with the samples that the forcing used.
    """
    problem = replace(null.objective, noise=noise)
    fitted = minimise(problem, forcing.phi[: problem.modes], STEPS, TOLERANCE)
    return HypothesisFit(build_law(problem, fitted, fitted.cost), problem, fitted.phi)


def add_faults(fit: HypothesisFit, sensors: tuple[int, ...]) -> HypothesisFit:
    """Return a hypothesis that was fitted without some sensors, with their faults added.

    A sensor is sound if no fault of it lowers the score.
    """
    return _add_likeliest_faults(fit, sensors)[0]


def _add_likeliest_faults(
    fit: HypothesisFit, sensors: tuple[int, ...]
) -> tuple[HypothesisFit, ExcludedSensors]:
    full_problem, phi = with_all_samples(fit.objective), fit.phi
    problem = FaultProblem.at(full_problem, phi, full_problem.linearise(phi))
    block = full_problem.forward_model.sensors
    columns = [column for sensor in sensors for column in block.columns_of(sensor)]
    found = find_faults(problem, columns, FAULT_KINDS, len(sensors))
    [cost], _ = fit.objective.values(phi[None])
    score = fit.law.score - float(cost) + found.score
    estimates = zip(found.faults, found.parameters, found.covariances, strict=True)
    in_units = tuple(fault_in_units(full_problem, *each) for each in estimates)
    law = replace(fit.law, score=score, faults=in_units)
    excluded = ExcludedSensors(fit, sensors, problem.faults.score - found.score)
    return replace(fit, law=law, excluded=excluded), excluded


def add_faults_or_refit(
    laws: Sequence[HypothesisFit], sensors: tuple[int, ...]
) -> list[HypothesisFit]:
    """Add the sensors' faults to laws fitted without them, or refit these to all sensors.

    The faults are added if they improve the best law. Otherwise the sensors are taken to be sound.
    """
    if not laws:
        return []
    pairs = [_add_likeliest_faults(law, sensors) for law in laws]
    best_index = min(range(len(laws)), key=lambda j: pairs[j][0].law.score)
    best, excluded = pairs[best_index]
    best_law = laws[best_index]
    refit_best = _refit_with_all_sensors(best_law)
    if excluded.gain <= 0 or refit_best.law.score < best.law.score:
        return [refit_best if law is best_law else _refit_with_all_sensors(law) for law in laws]
    return [*(with_faults for with_faults, _ in pairs), refit_best]


def _refit_with_all_sensors(fit: HypothesisFit) -> HypothesisFit:
    """Refit a hypothesis that was fitted without some sensors to all sensors."""
    return refit(fit, with_all_samples(fit.objective))


def with_all_samples(objective: LeastSquaresProblem) -> LeastSquaresProblem:
    """Return F of all recorded samples."""
    return replace(objective, noise=replace(objective.noise, available=~objective.recorded.isnan()))
