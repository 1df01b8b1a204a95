"""Sensor faults beside the best law, and what a free forcing explains beside or instead of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from torch import Tensor

from dashred.inference.fit.law import Law
from dashred.inference.hypotheses.comparison.needless_terms import drop_needless_terms
from dashred.inference.hypotheses.comparison.noise_reestimation import refit_under_noise
from dashred.inference.hypotheses.comparison.residual_forcing import ResidualForcing
from dashred.inference.hypotheses.forcing_levels import evidence
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, by_score, refit
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN, MAX_EXPLAINED_CHI2
from dashred.inference.hypotheses.sensors.early_fault import without_sensors
from dashred.inference.hypotheses.sensors.fault_fits import fit_sensor_hypotheses
from dashred.inference.sensor_faults.fault_table import DISTINCT_KINDS
from dashred.inference.sensor_faults.neighbours import has_neighbours

# A source lowers the misfit of the sensors that see it by more than this.
SEEN = 2 * AMBIGUITY_MARGIN


def search_faults_beside_best(
    fits: Sequence[HypothesisFit], searched: Collection[frozenset[str]]
) -> list[HypothesisFit]:
    """Return better hypotheses that add sensor faults to the best law.

    If the best one has faults, they are searched anew beside its law: under a smaller noise, faults
    of other sensors may show.

    Args:
        fits: hypotheses under one noise.
        searched: parts of the laws beside which faults have been searched under this noise.
    """
    best = min(fits, key=by_score)
    keys = best.law.keys
    same = [fit for fit in fits if fit.law.keys == keys and _is_plain(fit)]
    # The modes of a start cannot express every field. What they leave looks like wandering sensors.
    if best.law.start_prior_factor > 1:
        return []
    if best.excluded is not None or not same or same[0].law.parts in searched:
        return []
    base = min(same, key=by_score)
    found = fit_sensor_hypotheses(base, best.law.score)
    better = [fit for fit in found if fit.law.score < best.law.score]
    if not better or not base.law.candidates:
        return better
    [cost], _ = base.objective.values(base.phi[None])
    penalty = (base.law.score - float(cost)) / len(base.law.candidates)
    return [*better, *drop_needless_terms(min(better, key=by_score), penalty)]


def _is_plain(fit: HypothesisFit) -> bool:
    """Tell whether a hypothesis has neither faults nor another start."""
    return not fit.law.faults and fit.law.start_prior_factor == 1


def forcing_gain_beside(fit: HypothesisFit, tendency_rms: Tensor) -> float:
    """Return the evidence that a free forcing gains on a law, without the faulty sensors.

    Args:
        fit: a law with faults.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.
    """
    objective = without_sensors(fit.objective, (fault.sensor for fault in fit.faults))
    model, count = objective.forward_model, objective.forward_model.law.count
    model = replace(model, sensors=replace(model.sensors, errors=()))
    sound = replace(objective, forward_model=model, prior_std=objective.prior_std[:count])
    phi = fit.phi[: objective.modes + count]
    return fit_free_forcing(sound, phi, tendency_rms)[1]


def has_neighbouring_faults(fit: HypothesisFit) -> bool:
    """Tell whether sensors that are next to each other err under a hypothesis.

    Sensors that are stuck or have spikes do not count: no law has such an effect.
    """
    model, law = fit.objective.forward_model, fit.law
    erring = {fault.sensor for fault in law.faults if fault.kind not in DISTINCT_KINDS}
    sensors = model.sensors.operator.sensors
    chosen = [sensor for sensor in sensors if sensor.name in erring]
    return has_neighbours(sensors, chosen, model.simulator.system.axes)


def is_seen_by_one_sensor(source: HypothesisFit, fits: Sequence[HypothesisFit]) -> bool:
    """Tell whether a fault of one sensor explains the recording, and no other one sees a source.

    A narrow source of any course at a sensor imitates any error of it. A real one spreads: it
    lowers the misfit of other sensors, too.

    Args:
        source: the law of a source.
        fits: the other hypotheses, under the same noise.
    """
    faulty = [fit for fit in fits if not fit.law.candidates and _is_of_one_sensor(fit.law)]
    explained = [fit for fit in faulty if fit.law.chi2 < MAX_EXPLAINED_CHI2]
    if not explained:
        return False
    fault = min(explained, key=by_score)
    block, noise = fault.objective.forward_model.sensors, fault.objective.noise
    names = [sensor.name for sensor in block.operator.sensors]
    both = [fault.law.residuals, source.law.residuals]
    others = noise.available & ~both[0].isnan() & ~both[1].isnan()
    others[:, block.columns_of(names.index(fault.law.faults[0].sensor))] = False
    seen = replace(noise, available=others)
    with_fault, with_source = (float(seen.whiten(each).square().sum()) for each in both)
    return with_fault - with_source < SEEN


def _is_of_one_sensor(law: Law) -> bool:
    return len({fault.sensor for fault in law.faults}) == 1


def is_curves_alone(law: Law) -> bool:
    """Tell whether wandering sensors explain the recording without any law."""
    return not law.candidates and any(fault.kind == "wandering" for fault in law.faults)


def forcing_gain_over(faults: HypothesisFit, null: HypothesisFit, forcing: FreeForcing) -> float:
    """Return the evidence that a free forcing gains over sensor faults, under the same noise.

    Args:
        faults: the uncorrected simulator with sensor faults.
        null: the uncorrected simulator, under the same noise.
        forcing: a forcing on top of the uncorrected simulator, fitted under another noise.
    """
    problem = replace(forcing.objective, noise=null.objective.noise)
    there = replace(forcing, objective=problem, normal=problem.linearise(forcing.phi))
    gain = evidence(null.normal, range(len(null.phi))) - there.evidence
    return faults.law.score - (null.law.score - gain)


def refit_rivals_beside_faults(
    residual: ResidualForcing, fits: Sequence[HypothesisFit], rivals: Sequence[HypothesisFit]
) -> list[HypothesisFit]:
    """Return the rivals of the best law with and without a sensor fault, if it won with one.

    Without the fault their scores could not be compared with that of the best law.
    """
    best_fit, noise = min(fits, key=by_score), residual.full_problem.noise
    if not best_fit.law.faults or best_fit.law.keys != residual.best.law.keys:
        return []
    if residual.faulty:
        refits = [refit(rival, replace(rival.objective, noise=noise)) for rival in rivals]
        return residual.add_faults(refits)
    bound = best_fit.law.score + AMBIGUITY_MARGIN
    refits = [refit_under_noise(rival, noise) for rival in rivals]
    with_faults = [fit for rival in refits for fit in fit_sensor_hypotheses(rival, bound)]
    return [*refits, *with_faults]
