"""The findings in two sentences, for a reader who knows the system but not the statistics."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dashred.core.formatting import joined, number, sentence
from dashred.core.units import NO_UNITS
from dashred.reporting.text.causes import cause_text, fault_causes
from dashred.reporting.text.fitted_parameters import values_in_a_row
from dashred.reporting.text.improvement import (
    FEW_SAMPLES,
    OTHER_CAUSES,
    error_before,
    has_only_parameters,
    is_lost,
)
from dashred.reporting.text.laws import FEW
from dashred.reporting.text.parameters import short_parameter_text
from dashred.reporting.text.sources import located_source, short_source_text
from dashred.reporting.text.support import is_confirmed, is_scant, is_unsupported, nearest

PLACES = {
    "test_sensors": "at sensors not used in any fit",
    "heldout_episode": "in an episode not used in any fit",
    "heldout_time": "in the held-out time",
    "heldout_restarted": "in the held-out time, from a state fitted just before it,",
}
# Ratios of errors nearer to 1 than this count as no difference.
SAME = 1.05
# Error of the mean of the readings, in their standard deviations.
OF_THE_MEAN = 1.0


def headline(findings: Mapping[str, Any], mostly: Sequence[str] = ()) -> str:
    """Return one sentence on what is wrong with the simulation, and one on the improvement.

    Args:
        findings: of ``findings.json``.
        mostly: of many terms, the effects of the few that explain nearly all.
    """
    is_corrected = (
        findings["terms"] or findings["verdict"] in OTHER_CAUSES or has_only_parameters(findings)
    )
    improvement = _improvement(findings) if is_corrected else None
    # A fault that is the verdict is in the conclusion.
    has_law = findings["verdict"] in ("missing-term", "parameter", "outside-library")
    faults = _faults(findings) if has_law else None
    texts = (_conclusion(findings, mostly), faults, improvement)
    return " ".join(sentence(text) for text in texts if text)


def gain(findings: Mapping[str, Any]) -> tuple[str, float] | None:
    """Return the first held-out data there are, and the factor by which the error decreases.

    The factor is infinite if the run without the correction diverges, and 0 if the corrected one
    does; data for which both diverge are passed over.

    For a law that is not confirmed they are the first data that contradict it. For a faulty sensor
    they are not the test sensors, which have no fault. In a chaotic system a law is compared with
    the simulation over the times that can be predicted.
    """
    verdict, fit, contradicted = findings["verdict"], findings["fit"], not is_confirmed(findings)
    compared = {each["data"]: each for each in fit.get("comparisons", ())}
    for key in PLACES:
        if verdict == "sensor-fault" and key == "test_sensors":
            continue
        if findings["terms"] and is_lost(fit, key):
            continue
        errors = fit.get(key) or {}
        before, after = error_before(findings, key), errors.get("corrected")
        if findings["terms"] and key in compared:
            law = compared[key]
            # The table has no error over the times that can be predicted.
            if law["horizon"] is not None or contradicted:
                before, after = _error(law["before"]), _error(law["after"])
        if contradicted and not compared.get(key, {}).get("worse"):
            continue
        if before is None or after is None or not (before > 0 and after > 0):
            continue
        if math.isfinite(before) or math.isfinite(after):
            return key, before / after
    return None


def _error(stored: float | None) -> float:
    """Return an error; null stands for that of a run that blows up."""
    return math.inf if stored is None else stored


def _conclusion(findings: Mapping[str, Any], mostly: Sequence[str]) -> str:
    terms = findings["terms"] or []
    effects = [str(term["effect"]) for term in terms if term["equation"] is not None]
    missing = _listed(effects, mostly)
    changed = [short_parameter_text(term) for term in terms if term["equation"] is None]
    units = findings.get("units", NO_UNITS)
    fitted = findings.get("fitted_parameters")
    simulation = "the simulation with the fitted parameters" if fitted else "the simulation"
    match findings["verdict"]:
        case "nothing-missing" if fitted:
            return (
                f"the equations with {values_in_a_row(fitted)} explain the recording: these "
                "sensors show no missing term"
            )
        case "nothing-missing":
            return "the simulation agrees with the recording: these sensors show nothing missing"
        case "initial-condition":
            return f"{simulation} agrees with the recording, but it starts from the wrong state"
        case "sensor-fault":
            return f"{simulation} agrees with the recording, but {_faults(findings)}"
        case "unresolved-numerics":
            return "no conclusion is possible: the numerical error of the simulation is too large"
        case "not-converged":
            return "no result: the simulation could not be fitted to the recording with any law"
        case "mismatch":
            return (
                "the recording differs from every snapshot of the simulation; the cause cannot be "
                "determined without a simulator that runs"
            )
        case "no-mismatch-seen":
            return "the recording agrees with the snapshots of the simulation"
        case "outside-library" if (source := located_source(findings)) is not None:
            return f"the simulation lacks {short_source_text(source, units)}"
        case "outside-library" if missing and "terms" in (findings["causes"] or [{}])[0]:
            return f"the simulation leaves out {missing}, in a form that is not in its library"
        case "outside-library":
            refuted = ", which no held-out data support" if is_unsupported(findings) else ""
            if not is_confirmed(findings):
                refuted = ", which the held-out data contradict"
            best = f"; the nearest is {missing}{refuted}" if missing else ""
            nothing_explains = "no law with a few terms from the library explains the recording"
            return f"{nothing_explains}{best}"
        case "unconfirmed" if not terms:
            return (
                "there is no confirmed result: faulty sensors would explain the readings used in "
                "the fit, but held-out data disagree with the simulation, too"
            )
        case "unconfirmed" if is_scant(findings):
            return (
                "there is no confirmed result: the readings are too few to prove the best law "
                f"({_listed(effects + changed, mostly)})"
            )
        case "unconfirmed":
            return (
                "there is no confirmed result: the held-out data contradict the best law "
                f"({_listed(effects + changed, mostly)})"
            )
        case "ambiguous":
            best = f"; the best guess is {_listed(effects + changed, mostly)}" if terms else ""
            return f"several explanations fit this recording about equally well{best}"
        case "parameter":
            return f"the simulation has {_wrong(changed)}: {_listed(changed)}"
        case "missing-term":
            also = f", and it has {_wrong(changed)}: {_listed(changed)}" if changed else ""
            return f"the simulation leaves out {missing}{also}"
    return "there is no verdict"


def _wrong(changed: Sequence[str]) -> str:
    return "a wrong parameter" if len(set(changed)) == 1 else "wrong parameters"


def _faults(findings: Mapping[str, Any]) -> str | None:
    """Return the faulty sensors, also beside a missing law; None if there are none."""
    faults = fault_causes(findings["causes"] or [])
    if not faults:
        return None
    units = findings.get("units", NO_UNITS)
    texts = "; ".join(filter(None, (cause_text(fault, units) for fault in faults)))
    number = "a sensor is faulty" if len(faults) == 1 else f"{len(faults)} sensors are faulty"
    # What the nearest law does not explain may look like the error of a sensor.
    under = f"under the {nearest(findings)}, " if nearest(findings) else ""
    return f"{under}{number}: {texts}"


def _listed(parts: Sequence[str], mostly: Sequence[str] = ()) -> str:
    """Return the effects in a row, each once: terms that differ may have the same effect."""
    if len(parts) <= FEW:
        return _in_a_row(parts)
    if not mostly:
        return f"{len(parts)} effects at once"
    return f"mostly {_in_a_row(mostly)} ({len(parts)} terms in all)"


def _in_a_row(parts: Sequence[str]) -> str:
    """Return different parts as a list; one that contains a comma needs an ``and`` between all."""
    different = list(dict.fromkeys(parts))
    if any("," in part for part in different) or not different:
        return " and ".join(different)
    return joined(different)


def _improvement(findings: Mapping[str, Any]) -> str | None:
    found = gain(findings)
    if found is None:
        return None
    key, ratio = found
    samples = findings["fit"].get("held_out_samples", {}).get(key, FEW_SAMPLES)
    only = f", in {samples} samples only" if samples < FEW_SAMPLES else ""
    if ratio in (0, math.inf):
        how = "without" if ratio else "with"
        return f"{how} this correction the simulation diverges {PLACES[key].rstrip(',')}"
    change = "unchanged"
    if ratio >= SAME:
        change = f"{_times(ratio)} smaller"
        if _is_useless(findings["fit"], key):
            only = f"{only}, but it still exceeds the error of a constant prediction"
    elif ratio <= 1 / SAME:
        change = f"{_times(1 / ratio)} larger"
    return f"with this correction, the error {PLACES[key]} is {change}{only}"


def _is_useless(fit: Mapping[str, Any], key: str) -> bool:
    """Return whether the mean of the readings predicts them better than the corrected run.

    A run of a chaotic system predicts the first of them, and is compared at these alone.
    """
    cut = any(c["horizon"] is not None for c in fit.get("comparisons", ()) if c["data"] == key)
    error = (fit.get(key) or {}).get("corrected")
    return not cut and error is not None and error >= OF_THE_MEAN


def _times(ratio: float) -> str:
    return f"{number(float(f'{ratio:.2g}'))} times"
