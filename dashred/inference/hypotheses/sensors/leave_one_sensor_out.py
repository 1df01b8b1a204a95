"""A sensor at fault beneath a mismatch: found by what the others say of it, then left out.

While a law is missing too, no fit of the simulator can tell the fault. A free forcing explains what
the other sensors read, whatever the law; laws are then looked for without that sensor, and what is
wrong with it is read off the law that was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dashred.inference.fit.law import law_of
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.faulty_sensor_model import columns_of
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, refitted
from dashred.inference.hypotheses.sensors.fault_in_units import fault_in_units
from dashred.inference.hypotheses.sensors.faults import Fault, predicted_faults
from dashred.inference.hypotheses.sensors.suspects import suspects

# A forcing is coarse: what it leaves at a sensor may look like a fault that gains as much as this,
# in units of the misfit that it leaves everywhere.
COARSE = 40.0
# Of fewer sensors, none is left out: who contradicts whom, nobody can tell.
FEWEST = 3
STEPS, TOLERANCE = 6, 1e-3


def fault_beneath(forced: FreeForcing) -> Fault | None:
    """Return the fault of a sensor that even a free forcing needs; None if it needs none."""
    objective, phi = forced.objective, forced.phi
    sensors = objective.forward_model.operator.sensors
    seen = objective.noise.seen.any(dim=0).tolist()
    if len({s.name for s, any_ in zip(sensors, seen, strict=True) if any_}) < FEWEST:
        return None
    faults = suspects(objective, forced.normal)
    found = predicted_faults(objective, phi, forced.normal, faults)
    best, fault = min(found, key=lambda pair: pair[0].score)
    misfit = max(1.0, forced.cost / objective.noise.count)
    return fault if best.score < forced.cost - COARSE * misfit else None


def forced_without(forced: FreeForcing, sensor: int) -> FreeForcing:
    """Return a free forcing of the same size that one of the sensors has no part in."""
    seen = forced.objective.noise.seen.clone()
    seen[:, columns_of(forced.objective.forward_model.operator.sensors, sensor)] = False
    noise = replace(forced.objective.noise, seen=seen)
    mine = replace(forced.objective, noise=noise)
    fitted = minimise(mine, forced.phi, STEPS, TOLERANCE)
    normal = mine.linearise(fitted.phi, fitted.readings)
    return replace(forced, objective=mine, phi=fitted.phi, cost=fitted.cost, normal=normal)


def nothing_without(null: HypothesisFit, forced: FreeForcing, noise: NoiseModel) -> HypothesisFit:
    """Return the simulator as it is, fitted without the sensor that a free forcing has left out.

    Args:
        null: its fit to all sensors, which the faulty one may have led anywhere.
        forced: from whose start it is fitted.
        noise: that the forcing leaves, of the samples that it has seen.
    """
    mine = replace(null.objective, noise=noise)
    fitted = minimise(mine, forced.phi[: mine.modes], STEPS, TOLERANCE)
    return HypothesisFit(law_of(mine, fitted, (), fitted.cost), mine, fitted.phi)


@dataclass(frozen=True)
class Beside(HypothesisFit):
    """An explanation that was fitted without a sensor, beside what is wrong with that.

    Attributes:
        bare: the explanation alone.
        sensor: index of the sensor.
        gain: by how much F is lower with the fault than without, penalty and all, were the model
            linear: a fit to all samples may get stuck, and its F is no match for a linear one.
    """

    bare: HypothesisFit
    sensor: int
    gain: float


def beside_the_fault(bare: HypothesisFit, sensor: int) -> Beside:
    """Return an explanation that was fitted without a sensor, beside what is wrong with that."""
    whole, phi = _whole(bare.objective), bare.phi
    normal = whole.linearise(phi)
    own = columns_of(whole.forward_model.operator.sensors, sensor)
    mine = [fault for fault in suspects(whole, normal) if fault.sensor in own]
    found = predicted_faults(whole, phi, normal, mine)
    best, fault = min(found, key=lambda pair: pair[0].score)
    [cost], _ = bare.objective.values(phi[None])
    score = bare.law.score - float(cost) + best.score
    law = replace(bare.law, score=score, fault=fault_in_units(whole, fault, best.own, best.stds))
    return Beside(law, bare.objective, phi, bare, sensor, normal.least() - best.score)


def faulty_or_not(laws: Sequence[HypothesisFit], sensor: int) -> list[HypothesisFit]:
    """Return laws that were fitted without a sensor as the best of them has it.

    Beside the sensor's fault, if that explains what it reads; else fitted to it, too.
    """
    if not laws:
        return []
    found = [beside_the_fault(law, sensor) for law in laws]
    best = min(found, key=lambda cause: cause.law.score)
    without = _with_all_sensors(best.bare)
    if best.gain <= 0 or without.law.score < best.law.score:
        return [without if law is best.bare else _with_all_sensors(law) for law in laws]
    return [*found, without]


def _with_all_sensors(bare: HypothesisFit) -> HypothesisFit:
    """Return an explanation that was fitted without a sensor, fitted to that too."""
    return refitted(bare, _whole(bare.objective))


def _whole(objective: LeastSquaresProblem) -> LeastSquaresProblem:
    """Return F of all samples that there are."""
    return replace(objective, noise=replace(objective.noise, seen=~objective.recorded.isnan()))
