"""A sensor at fault beneath a mismatch: found by what the others say of it, then left out.

While a law is missing too, no fit of the simulator can tell the fault. A free forcing explains what
the other sensors read, whatever the law; laws are then looked for without that sensor, and what is
wrong with it is read off the law that was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.inference.fit.law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, LeftOut, refitted
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
    sensors = objective.forward_model.sensors.sensors
    seen = objective.noise.available.any(dim=0).tolist()
    if len({s.name for s, any_ in zip(sensors, seen, strict=True) if any_}) < FEWEST:
        return None
    faults = suspects(objective, forced.normal)
    found = predicted_faults(objective, phi, forced.normal, faults)
    best, fault = min(found, key=lambda pair: pair[0].score)
    misfit = max(1.0, forced.cost / objective.noise.count)
    return fault if best.score < forced.cost - COARSE * misfit else None


def forced_without(forced: FreeForcing, sensor: int) -> FreeForcing:
    """Return a free forcing of the same size that one of the sensors has no part in."""
    noise, sensors = forced.objective.noise, forced.objective.forward_model.sensors
    seen = noise.available.clone()
    seen[:, sensors.columns_of(sensor)] = False
    mine = replace(forced.objective, noise=replace(noise, available=seen))
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
    return HypothesisFit(build_law(mine, fitted, fitted.cost), mine, fitted.phi)


def beside_the_fault(bare: HypothesisFit, sensor: int) -> HypothesisFit:
    """Return an explanation that was fitted without a sensor, beside what is wrong with that."""
    return _with_fault(bare, sensor)[0]


def _with_fault(bare: HypothesisFit, sensor: int) -> tuple[HypothesisFit, LeftOut]:
    whole, phi = _whole(bare.objective), bare.phi
    normal = whole.linearise(phi)
    own = whole.forward_model.sensors.columns_of(sensor)
    mine = [fault for fault in suspects(whole, normal) if fault.sensor in own]
    found = predicted_faults(whole, phi, normal, mine)
    best, fault = min(found, key=lambda pair: pair[0].score)
    [cost], _ = bare.objective.values(phi[None])
    score = bare.law.score - float(cost) + best.score
    law = replace(bare.law, score=score, fault=fault_in_units(whole, fault, best.own, best.stds))
    left_out = LeftOut(bare, sensor, normal.minimum() - best.score)
    return replace(bare, law=law, left_out=left_out), left_out


def faulty_or_not(laws: Sequence[HypothesisFit], sensor: int) -> list[HypothesisFit]:
    """Return laws that were fitted without a sensor as the best of them has it.

    Beside the sensor's fault, if that explains what it reads; else fitted to it, too.
    """
    if not laws:
        return []
    found = [_with_fault(law, sensor) for law in laws]
    first = min(range(len(laws)), key=lambda j: found[j][0].law.score)
    best, left_out = found[first]
    without = _with_all_sensors(laws[first])
    if left_out.gain <= 0 or without.law.score < best.law.score:
        return [without if law is laws[first] else _with_all_sensors(law) for law in laws]
    return [*(beside for beside, _ in found), without]


def _with_all_sensors(bare: HypothesisFit) -> HypothesisFit:
    """Return an explanation that was fitted without a sensor, fitted to that too."""
    return refitted(bare, _whole(bare.objective))


def _whole(objective: LeastSquaresProblem) -> LeastSquaresProblem:
    """Return F of all samples that there are."""
    return replace(objective, noise=replace(objective.noise, available=~objective.recorded.isnan()))
