"""The verdict: the kind of cause that the recording supports, and the probable causes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import cast

from torch import Tensor

from dashred.core.findings.cause_schema import (
    NONE_OF_THESE,
    Cause,
    FaultCurve,
    FaultySensor,
    Verdict,
)
from dashred.inference.fit.law import Law, SensorFault
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.result import (
    MAX_EXPLAINED_CHI2,
    MIN_FORCING_GAIN,
    Discovery,
)
from dashred.inference.results.posterior_probabilities import posterior_probabilities

# If a larger share of the misfit is not noise, no start alone explains the recording: the residuals
# are then twice the noise. Of 267 compared runs, all above this limit were wrong.
UNEXPLAINED = 0.75
# A law that leaves so much of the misfit, and residuals of this size in standard deviations of the
# traces, is only the nearest one.
LARGE_RESIDUAL = 0.2
# The same holds for residuals half as large if they are ten times the noise. Of 282 runs, no right
# law left more than a share of 0.41.
TEN_TIMES_NOISE, VISIBLE_RESIDUAL = 0.99, 0.1
# The same holds for a law of more terms than this, whatever the size of its residuals. Of 289 runs,
# no right law of three or more terms left more than a share of 0.17.
FEW_TERMS = 2
# The fit of a law is incomplete if its misfit exceeds that of all candidates by this factor.
STUCK = 1.5


def describe_fault(fault: SensorFault) -> FaultySensor:
    """Return a fault as data, without the quantity and the position of its sensor."""
    curves: list[FaultCurve] = [
        {
            "episode": None,
            "times": list(curve.times),
            "value": list(curve.value),
            "std": list(curve.std),
        }
        for curve in fault.curves
    ]
    return {
        "sensor": fault.sensor,
        "fault": fault.kind,
        "value": fault.value,
        "std": fault.std,
        "from": fault.begin,
        "reads": None,
        "axis": None,
        "episode": None,
        "curve": curves or None,
    }


FaultDetails = Callable[[SensorFault], FaultySensor]


def verdict(
    discovery: Discovery,
    unexplained: float | None = None,
    details: FaultDetails = describe_fault,
    residual: float = 0.0,
) -> tuple[Verdict, list[Cause]]:
    """Return the verdict and its causes, the most probable first.

    A cause contains the kind of a class of laws, its probability, and the equations and changes of
    its best law. If the search did not converge, the reason is the only cause.

    Args:
        discovery: the laws.
        unexplained: share of the misfit of the best law that is not noise, if known
            (:func:`unexplained_share`).
        details: describes a fault of a sensor as data.
        residual: σ of the residuals of the best law in standard deviations of the traces, as the
            median over the sensors.
    """
    if reason := _not_converged(discovery, unexplained):
        return "not-converged", [reason]
    causes = _causes(discovery, details)
    if discovery.forcing_gain > MIN_FORCING_GAIN:
        found = _outside(gain=discovery.forcing_gain, misfit=discovery.best.chi2)
        if unexplained is not None:
            found["unexplained"] = unexplained
        return "outside-library", [found, *causes]
    if discovery.also_supported and discovery.best.chi2 > MAX_EXPLAINED_CHI2:
        further = len(discovery.also_supported)
        cause = _outside(misfit=discovery.best.chi2, supported=further)
        return "outside-library", [cause, *causes]
    left = unexplained or 0.0
    is_large = left > UNEXPLAINED and residual > LARGE_RESIDUAL
    is_large |= left > TEN_TIMES_NOISE and residual > VISIBLE_RESIDUAL
    is_large |= left > UNEXPLAINED and len(discovery.best.candidates) > FEW_TERMS
    if discovery.best.candidates and is_large:
        return "outside-library", [_outside(unexplained=left, residual=residual), *causes]
    kinds = {_kind(law) for law in (discovery.best, *discovery.rivals)}
    # Rivals do not make the verdict ambiguous if all are laws of the extended library.
    is_clear = not discovery.rivals or kinds == {"outside-library"}
    return (_kind(discovery.best) if is_clear else "ambiguous"), causes


def with_faults(
    kind: Verdict, causes: Sequence[Cause], faults: Iterable[FaultySensor]
) -> tuple[Verdict, list[Cause]]:
    """Return a verdict and its causes with further faulty sensors, which no fit has used.

    They are beside the leading cause; if nothing is missing, they are the verdict.
    """
    found = [_sensor_fault(1 - NONE_OF_THESE, fault) for fault in faults]
    if found and kind == "nothing-missing":
        return "sensor-fault", [*found, *causes]
    return kind, [*causes[:1], *found, *causes[1:]]


def unexplained_share(stated: Tensor | None, found: NoiseModel) -> float | None:
    """Return the share of the misfit of the best law that is not noise; None without stated σ.

    ``max(0, 1 - n / Σ (σ_found/σ_stated)²)`` over the n available samples. It is 0 if the residuals
    are as small as the noise, and 0.75 if they are twice as large.

    Args:
        stated: σ of each fit sensor, given by the user or estimated from the traces.
        found: noise model estimated from the residuals of the best law.
    """
    if stated is None:
        return None
    available = found.available.sum(dim=0)
    excess = float(((found.std / stated).square() * available).sum() / available.sum())
    return max(0.0, 1.0 - 1.0 / excess) if excess > 0 else 0.0


def _not_converged(discovery: Discovery, unexplained: float | None) -> Cause | None:
    """Return the reason why the search did not converge; None if it converged."""
    cause: Cause = {"kind": "not-converged", "probability": None, "where": None}
    if not discovery.is_horizon_complete:
        samples, level = discovery.levels[-1] if discovery.levels else (0, float("nan"))
        cause["reason"], cause["misfit"] = "window-not-reached", level
        cause["samples"], cause["samples_in_all"] = samples, len(discovery.noise.available)
        return cause
    if _is_stuck(discovery):
        cause["reason"], room = "law-not-fitted", discovery.room_left
        cause["misfit"], cause["misfit_of_all"] = discovery.best.chi2, discovery.free_chi2
        if room is not None and room.is_fitted:
            cause["reason"], cause["chance"] = "law-incomplete", room.chance
        return cause
    is_empty = not discovery.best.candidates and not discovery.best.faults
    if (
        is_empty
        and unexplained is not None
        and unexplained > UNEXPLAINED
        and discovery.forcing_gain <= MIN_FORCING_GAIN
    ):
        cause["reason"], cause["unexplained"] = "misfit-unexplained", unexplained
        return cause
    return None


def _is_stuck(discovery: Discovery) -> bool:
    """Return whether the fit of the best law is incomplete.

    With few readings, all candidates together fit the noise, too. A law whose misfit is not above
    the noise is then complete if its own fit has ended, and if noise explains the difference.
    """
    chi2, room = discovery.best.chi2, discovery.room_left
    if chi2 <= STUCK * discovery.free_chi2:
        return False
    return chi2 > 1 or room is None or not room.is_insignificant


def _causes(discovery: Discovery, details: FaultDetails) -> list[Cause]:
    probabilities: dict[Verdict, float] = {}
    best: dict[Verdict, Law] = {}
    probable = posterior_probabilities(discovery)
    for law, p in sorted(probable, key=lambda pair: pair[0].score):
        kind = _kind(law)
        best.setdefault(kind, law)
        probabilities[kind] = probabilities.get(kind, 0.0) + p
    causes: list[Cause] = []
    told: set[tuple[str, str]] = set()
    for kind in sorted(probabilities, key=lambda kind: -probabilities[kind]):
        law, probability = best[kind], min(1.0, probabilities[kind])
        causes.append(_cause(kind, probability, law, details))
        # A law or another start and several faults may all be true; the faults come last.
        if kind == "sensor-fault":
            told.add((law.faults[0].kind, law.faults[0].sensor))
        for fault in law.faults:
            if (fault.kind, fault.sensor) in told:
                continue
            told.add((fault.kind, fault.sensor))
            probability = _probability_of_fault(fault, probable)
            causes.append(_sensor_fault(probability, details(fault)))
    return causes


def _probability_of_fault(fault: SensorFault, probable: Sequence[tuple[Law, float]]) -> float:
    """Return the total probability of the laws with a fault of this kind and sensor."""
    found = [
        p
        for law, p in probable
        if (fault.kind, fault.sensor) in {(each.kind, each.sensor) for each in law.faults}
    ]
    return min(1.0, math.fsum(found))


def _outside(**details: float) -> Cause:
    """Return the cause for an effect that the given law does not express.

    It has no probability, because what is missing is not one of the fitted laws.

    Args:
        details: what shows the effect: the evidence for a free forcing, the residuals of the law,
            or the number of further terms that it needs.
    """
    cause: Cause = {"kind": "outside-library", "probability": None, "where": None}
    cause.update(cast(Cause, details))
    return cause


def _kind(law: Law) -> Verdict:
    if law.has_other_start:
        return "initial-condition"
    if law.faults and not law.candidates:
        return "sensor-fault"
    if not law.candidates:
        return "nothing-missing"
    if law.is_extended:
        return "outside-library"
    if all(candidate.equation is None for candidate in law.candidates):
        return "parameter"
    return "missing-term"


def _cause(kind: Verdict, probability: float, law: Law, details: FaultDetails) -> Cause:
    """Return the cause for the best law of a kind."""
    if kind == "sensor-fault":
        return _sensor_fault(probability, details(law.faults[0]))
    touched = {term.equation for candidate in law.candidates for term in candidate.terms}
    cause: Cause = {"kind": kind, "probability": probability, "where": None}
    if law.has_other_start:
        cause["start"] = law.start_prior_factor
        return cause
    cause["where"] = {"equations": sorted(touched)} if touched else None
    if kind == "parameter":
        cause["parameter"] = [candidate.name for candidate in law.candidates]
        return cause
    cause["terms"] = [str(candidate) for candidate in law.candidates]
    if kind == "outside-library":
        cause["extended"] = True
    if law.source is not None:
        cause["source"] = law.source.equation
    return cause


def _sensor_fault(probability: float, fault: FaultySensor) -> Cause:
    cause: Cause = {"kind": "sensor-fault", "probability": probability, "where": None}
    cause.update(cast(Cause, fault))
    return cause
