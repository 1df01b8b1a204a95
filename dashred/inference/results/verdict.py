"""The verdict: what kind of explanation the recording speaks for, and how clearly."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from torch import Tensor

from dashred.core.findings.schema import Verdict
from dashred.inference.fit.law import Law, SensorFault
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.result import MISSING, Discovery
from dashred.inference.results.posterior_probabilities import posterior_probabilities
from dashred.inference.wording.fault_wording import fault_in_words

FaultTold = Callable[[SensorFault], str]
# Share of the misfit that is not noise, beyond which no start alone explains a recording: residuals
# of twice the noise. Of 267 compared runs all that it takes were wrong, by their sealed truth.
UNEXPLAINED = 0.75
# Misfit, relative to the fit of all candidates, at which a law has not been fitted to the end.
STUCK = 1.5
EXTENDED = (
    "no law of the library explains the recording; what lies a step beyond it, of functions, "
    "higher powers and waves in space or time, does"
)


def verdict(
    discovered: Discovery, left: float | None = None, tell: FaultTold = fault_in_words
) -> tuple[Verdict, list[dict[str, Any]]]:
    """Return the verdict, and its causes by falling probability.

    A cause is ``{kind, probability, where, terms | parameter, says}``: the kind of a class of
    laws, its share of ``Σ exp(-score/2)``, and of its best law the equations and what it changes.
    A search that has not converged has one cause, which says why; its best law says nothing.

    Args:
        discovered: the laws.
        left: the share of the best law's misfit that is not noise (:func:`unexplained`), if known.
        tell: says what is wrong with a sensor.
    """
    if reason := _not_converged(discovered, left):
        cause = {"kind": "not-converged", "probability": 1.0, "where": None, "says": reason}
        return "not-converged", [cause]
    causes = _causes(discovered, tell)
    if discovered.forcing_gain > MISSING:
        return "outside-library", [_outside(discovered), *causes]
    kinds = {_kind(law) for law in (discovered.best, *discovered.rivals)}
    # Which of the laws beyond the library it is may be open, and yet that none of it does is not.
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


def _not_converged(discovered: Discovery, left: float | None) -> str | None:
    if not discovered.reached:
        samples, level = discovered.levels[-1] if discovered.levels else (0, float("nan"))
        return (
            f"the simulation could be fitted to the first {samples} of "
            f"{len(discovered.noise.seen)} samples (misfit {level:.3g}), and no further"
        )
    if discovered.best.chi2 > STUCK * discovered.free_chi2:
        return (
            f"the best law's misfit is {discovered.best.chi2:.3g} where all candidates together "
            f"reach {discovered.free_chi2:.3g}: no sparse law was fitted to the end"
        )
    lawless = not discovered.best.candidates and discovered.best.fault is None
    if lawless and left is not None and left > UNEXPLAINED and discovered.forcing_gain <= MISSING:
        return (
            f"nothing that was tried explains the recording: {left:.0%} of what is left is not the "
            "noise that was stated, or that the traces alone speak for"
        )
    return None


def _causes(discovered: Discovery, tell: FaultTold) -> list[dict[str, Any]]:
    probabilities: dict[Verdict, float] = {}
    best: dict[Verdict, Law] = {}
    plausible = posterior_probabilities(discovered)
    for law, p in sorted(plausible, key=lambda pair: pair[0].score):
        kind = _kind(law)
        best.setdefault(kind, law)
        probabilities[kind] = probabilities.get(kind, 0.0) + p
    causes = []
    for kind in sorted(probabilities, key=lambda kind: -probabilities[kind]):
        law, probability = best[kind], {"probability": min(1.0, probabilities[kind])}
        causes.append({"kind": kind} | probability | _details(law, tell))
        # More than one cause may be true: of a law and a fault the law stands first.
        if law.fault is not None and law.candidates:
            of_fault = {"probability": _of_fault(law.fault, plausible)}
            causes.append({"kind": "sensor-fault"} | of_fault | _fault(law.fault, tell))
    return causes


def _of_fault(fault: SensorFault, plausible: Sequence[tuple[Law, float]]) -> float:
    """Return the share of the laws with a fault of this kind and sensor."""
    found = [
        p
        for law, p in plausible
        if law.fault and (law.fault.kind, law.fault.sensor) == (fault.kind, fault.sensor)
    ]
    return min(1.0, math.fsum(found))


def _outside(discovered: Discovery) -> dict[str, Any]:
    says = (
        f"a free forcing on top of the best law gains {discovered.forcing_gain:.3g} in evidence: "
        "something is missing that no law of the library expresses, and the terms given are the "
        "nearest that do"
    )
    probability = 1 / (1 + math.exp(-discovered.forcing_gain / 2))
    return {"kind": "outside-library", "probability": probability, "where": None, "says": says}


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


def _details(law: Law, tell: FaultTold) -> dict[str, Any]:
    touched = {term.equation for candidate in law.candidates for term in candidate.terms}
    where = {"where": {"equations": sorted(touched)} if touched else None}
    if law.fault is not None and not law.candidates:
        return _fault(law.fault, tell)
    if law.widened > 1:
        says = f"the start lies outside of its prior, some {law.widened:g} times its spread"
        return {"where": None, "start": law.widened, "says": says}
    if _kind(law) == "parameter":
        return where | {"parameter": [candidate.name for candidate in law.candidates]}
    terms = {"terms": [str(candidate) for candidate in law.candidates]}
    if _kind(law) == "outside-library":
        return where | terms | {"says": EXTENDED}
    return where | terms


def _fault(fault: SensorFault, tell: FaultTold) -> dict[str, Any]:
    told = {"sensor": fault.sensor, "fault": fault.kind, "value": fault.value}
    return {"where": None, **told, "says": tell(fault)}
