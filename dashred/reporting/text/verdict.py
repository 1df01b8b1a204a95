"""The verdict with its details: causes, the law, its location, and its improvement."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import sentence
from dashred.core.units import NO_UNITS
from dashred.reporting.text.causes import reported_causes
from dashred.reporting.text.consequences import consequences
from dashred.reporting.text.improvement import (
    UNTESTED,
    assimilation_gains,
    forecast_limits,
    improvements,
    resolution_warning,
)
from dashred.reporting.text.laws import SUGGESTED, has_law, law, other_laws
from dashred.reporting.text.regions import location
from dashred.reporting.text.shared_parameters import shared_parameters
from dashred.reporting.text.sources import source
from dashred.reporting.text.support import contradictions, is_confirmed, is_scant, nearest

VERDICTS = {
    "missing-term": "a term is missing from the simulation",
    "nothing-missing": "nothing is missing from the simulation",
    "parameter": "a parameter of the simulation has a wrong value",
    "initial-condition": "the simulation starts from the wrong state",
    "sensor-fault": "a sensor is faulty, not the simulation",
    "unresolved-numerics": "the simulation is not resolved, so its physics cannot be assessed",
    "outside-library": "no law with a few terms from the library explains the recording",
    "ambiguous": "several explanations fit about equally well",
    "not-converged": "the search did not converge",
    "mismatch": "the recording differs from the simulation, and snapshots alone cannot show why",
    "no-mismatch-seen": "the recording agrees with the simulation's snapshots",
    "unconfirmed": "an explanation fits the recording, but the held-out data contradict it",
}
# The meaning of missing-term for more than one.
SEVERAL_TERMS = "terms are missing from the simulation"
# The meaning of unconfirmed if no held-out data contradict the law.
TOO_FEW = "an explanation fits the recording, but the readings are too few to prove it"
# The meaning of nothing-missing if the simulation agrees with fitted parameters.
NOTHING_BESIDE_PARAMETERS = "the equations with the fitted parameters explain the recording"
LIMITS = "Limits of this analysis"


def verdict_lines(findings: Mapping[str, Any]) -> list[str]:
    """Return the verdict and its details, one or two sentences a line; empty without a verdict."""
    verdict = findings["verdict"]
    if verdict is None:
        return []
    head = f"Verdict: {verdict}: {meaning(findings)}."
    unknown = limits(findings)
    body = [
        *contradictions(findings),
        *causes(findings),
        *source(findings),
        *law(findings),
        *other_laws(findings),
        *resolution_warning(findings["fit"]),
        *location(
            findings["where"] if has_law(findings) else None, findings.get("units", NO_UNITS)
        ),
        *consequences(findings),
        *improvements(findings),
        *forecast_limits(findings),
        *assimilation_gains(findings),
        *shared_parameters(findings),
        *([f"{LIMITS}:"] if unknown else []),
        *(f"- {text}" for text in unknown),
    ]
    return [head, *(f"  {line}" for line in body)]


def meaning(findings: Mapping[str, Any]) -> str:
    """Return the meaning of the verdict in a few words."""
    verdict = findings["verdict"]
    if verdict == "nothing-missing" and findings.get("fitted_parameters"):
        return NOTHING_BESIDE_PARAMETERS
    if verdict == "missing-term" and len(findings["terms"] or ()) > 1:
        return SEVERAL_TERMS
    if is_scant(findings):
        return TOO_FEW
    return VERDICTS.get(verdict, "see findings.json")


def causes(findings: Mapping[str, Any]) -> list[str]:
    """Return the texts of the reported causes."""
    told = [_says(findings, cause) for cause in reported_causes(findings) if "says" in cause]
    if told and not is_confirmed(findings) and not findings["terms"]:
        told[0] = f"{SUGGESTED}: {told[0]}"
    return [sentence(text) for text in told]


def _says(findings: Mapping[str, Any], cause: Mapping[str, Any]) -> str:
    """Return the text of a cause; a fault beside the nearest law is as uncertain as the law.

    The same holds for a fault if no law is near.
    """
    splits = findings["input"]["splits"] or {"validate": (), "test": ()}
    is_tested = cause.get("sensor") in (*splits["validate"], *splits["test"])
    beside = nearest(findings) if cause["kind"] == "sensor-fault" and not is_tested else ""
    return f"in the {beside}, {cause['says']}" if beside else str(cause["says"])


def limits(findings: Mapping[str, Any]) -> list[str]:
    """Return what an analysis of snapshots cannot determine."""
    if findings["verdict"] not in UNTESTED:
        return []
    return [sentence(text) for text in findings["causes"][0]["cannot_know"]]
