"""The verdict: the kind of explanation that the recording supports, and its causes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import cast

from torch import Tensor

from dashred.core.findings.cause_schema import Cause, FaultySensor, Verdict
from dashred.inference.fit.law import Law, SensorFault
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.result import MISSING, Discovery
from dashred.inference.results.posterior_probabilities import posterior_probabilities

# Share of the misfit that is not noise, beyond which no start alone explains a recording: residuals
# of twice the noise. Of 267 compared runs, all that exceed it were wrong by their hidden truth.
UNEXPLAINED = 0.75
# Misfit, relative to the fit of all candidates, at which a law has not been fitted to the end.
STUCK = 1.5


def fault_found(fault: SensorFault) -> FaultySensor:
    """Return a fault as data, without what its sensor reads and where it stands."""
    return {
        "sensor": fault.sensor,
        "fault": fault.kind,
        "value": fault.value,
        "std": fault.std,
        "from": fault.begin,
        "reads": None,
        "axis": None,
        "episode": None,
    }


FaultDetails = Callable[[SensorFault], FaultySensor]


def verdict(
    discovered: Discovery, left: float | None = None, details: FaultDetails = fault_found
) -> tuple[Verdict, list[Cause]]:
    """Return the verdict, and its causes by falling probability.

    A cause holds the kind of a class of laws, its share of ``Σ exp(-score/2)``, and of its best law
    the equations and what it changes. A search that did not converge has one cause, the reason.

    Args:
        discovered: the laws.
        left: the share of the best law's misfit that is not noise (:func:`unexplained`), if known.
        details: describes a fault of a sensor as data.
    """
    if reason := _not_converged(discovered, left):
        return "not-converged", [reason]
    causes = _causes(discovered, details)
    if discovered.forcing_gain > MISSING:
        return "outside-library", [_outside(discovered), *causes]
    kinds = {_kind(law) for law in (discovered.best, *discovered.rivals)}
    # Which law of the extended library is right may be open, even if no law of the library is.
    clear = not discovered.rivals or kinds == {"outside-library"}
    return (_kind(discovered.best) if clear else "ambiguous"), causes


def unexplained(stated: Tensor | None, found: NoiseModel) -> float | None:
    """Return the share of the best law's misfit that is not the recording's own noise.

    ``max(0, 1 - n / Σ (σ_found/σ_stated)²)`` over the n samples there are: 0 if the residuals are
    as small as the noise, 0.75 if they are twice as large. Null where no σ is known.

    Args:
        stated: σ of each fit sensor, stated by the user or estimated from the traces alone.
        found: the noise that the best law's residuals speak for.
    """
    if stated is None:
        return None
    seen = found.seen.sum(dim=0)
    excess = float(((found.std / stated).square() * seen).sum() / seen.sum())
    return max(0.0, 1.0 - 1.0 / excess) if excess > 0 else 0.0


def _not_converged(discovered: Discovery, left: float | None) -> Cause | None:
    """Return why the search did not converge; None where it did."""
    cause: Cause = {"kind": "not-converged", "probability": 1.0, "where": None}
    if not discovered.reached:
        samples, level = discovered.levels[-1] if discovered.levels else (0, float("nan"))
        cause["reason"], cause["misfit"] = "window-not-reached", level
        cause["samples"], cause["samples_in_all"] = samples, len(discovered.noise.seen)
        return cause
    if discovered.best.chi2 > STUCK * discovered.free_chi2:
        cause["reason"] = "law-not-fitted"
        cause["misfit"], cause["misfit_of_all"] = discovered.best.chi2, discovered.free_chi2
        return cause
    lawless = not discovered.best.candidates and discovered.best.fault is None
    if lawless and left is not None and left > UNEXPLAINED and discovered.forcing_gain <= MISSING:
        cause["reason"], cause["unexplained"] = "misfit-unexplained", left
        return cause
    return None


def _causes(discovered: Discovery, details: FaultDetails) -> list[Cause]:
    probabilities: dict[Verdict, float] = {}
    best: dict[Verdict, Law] = {}
    plausible = posterior_probabilities(discovered)
    for law, p in sorted(plausible, key=lambda pair: pair[0].score):
        kind = _kind(law)
        best.setdefault(kind, law)
        probabilities[kind] = probabilities.get(kind, 0.0) + p
    causes: list[Cause] = []
    for kind in sorted(probabilities, key=lambda kind: -probabilities[kind]):
        law, probability = best[kind], min(1.0, probabilities[kind])
        causes.append(_cause(kind, probability, law, details))
        # More than one cause may be true: of a law and a fault the law stands first.
        if law.fault is not None and law.candidates:
            probability = _probability_of_fault(law.fault, plausible)
            causes.append(_sensor_fault(probability, details(law.fault)))
    return causes


def _probability_of_fault(fault: SensorFault, plausible: Sequence[tuple[Law, float]]) -> float:
    """Return the share of the laws with a fault of this kind and sensor."""
    found = [
        p
        for law, p in plausible
        if law.fault and (law.fault.kind, law.fault.sensor) == (fault.kind, fault.sensor)
    ]
    return min(1.0, math.fsum(found))


def _outside(discovered: Discovery) -> Cause:
    """Return the cause of a missing effect that a free forcing shows, and no law expresses."""
    return {
        "kind": "outside-library",
        "probability": 1 / (1 + math.exp(-discovered.forcing_gain / 2)),
        "where": None,
        "gain": discovered.forcing_gain,
    }


def _kind(law: Law) -> Verdict:
    if law.fault is not None and not law.candidates:
        return "sensor-fault"
    if law.widened > 1:
        return "initial-condition"
    if not law.candidates:
        return "nothing-missing"
    if law.extended:
        return "outside-library"
    if all(candidate.equation is None for candidate in law.candidates):
        return "parameter"
    return "missing-term"


def _cause(kind: Verdict, probability: float, law: Law, details: FaultDetails) -> Cause:
    """Return the cause that the best law of its kind stands for."""
    if law.fault is not None and not law.candidates:
        return _sensor_fault(probability, details(law.fault))
    touched = {term.equation for candidate in law.candidates for term in candidate.terms}
    cause: Cause = {"kind": kind, "probability": probability, "where": None}
    if law.widened > 1:
        cause["start"] = law.widened
        return cause
    cause["where"] = {"equations": sorted(touched)} if touched else None
    if kind == "parameter":
        cause["parameter"] = [candidate.name for candidate in law.candidates]
        return cause
    cause["terms"] = [str(candidate) for candidate in law.candidates]
    if kind == "outside-library":
        cause["extended"] = True
    return cause


def _sensor_fault(probability: float, fault: FaultySensor) -> Cause:
    cause: Cause = {"kind": "sensor-fault", "probability": probability, "where": None}
    cause.update(cast(Cause, fault))
    return cause
