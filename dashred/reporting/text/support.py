"""Whether the held-out data support the law that the findings state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import plural, rounded
from dashred.reporting.text.improvement import (
    HELD_OUT,
    HUGE,
    SAME,
    error_before,
    error_text,
    is_lost,
)


def is_confirmed(findings: Mapping[str, Any]) -> bool:
    """Return whether the held-out data do not contradict the law that the findings state.

    Where no law of the library expresses what is missing, they may contradict the nearest one.
    """
    worse = any(each["worse"] for each in findings["fit"].get("comparisons", ()))
    has_nearest = findings["verdict"] == "outside-library" and bool(findings["terms"])
    return bool(findings["verdict"] != "unconfirmed") and not (has_nearest and worse)


def is_unexplained(findings: Mapping[str, Any]) -> bool:
    """Return whether no fitted law explains the recording."""
    leading: Mapping[str, Any] = (findings["causes"] or [{}])[0]
    return findings["verdict"] == "outside-library" and "terms" not in leading


def names_nearest_law(findings: Mapping[str, Any]) -> bool:
    """Return whether the stated law is only the nearest one to what is missing."""
    return is_unexplained(findings) and bool(findings["terms"])


def nearest(findings: Mapping[str, Any]) -> str:
    """Return ``nearest law`` or ``nearest explanation`` if this is all that is stated, else ""."""
    if names_nearest_law(findings):
        return "nearest law"
    leading: Mapping[str, Any] = (findings["causes"] or [{}])[0]
    return "nearest explanation" if is_unexplained(findings) and "gain" in leading else ""


def has_probabilities(findings: Mapping[str, Any]) -> bool:
    """Return whether the probabilities of causes and of terms may be told.

    They compare the fitted laws with each other. They say nothing if none of these explains the
    recording, or if held-out data contradict or nowhere support the law.
    """
    is_refuted = not is_confirmed(findings) or (findings["terms"] and is_unsupported(findings))
    return not is_refuted and not is_unexplained(findings)


def is_unsupported(findings: Mapping[str, Any]) -> bool:
    """Return whether there are held-out data, and the correction improves the error on none."""
    fit, changes = findings["fit"], []
    for key in HELD_OUT:
        if "corrected" in (fit.get(key) or {}) and not is_lost(fit, key):
            before, after = error_before(findings, key), fit[key]["corrected"]
            left, told = (HUGE if error is None else min(error, HUGE) for error in (before, after))
            changes.append(told < SAME * left)
    return bool(changes) and not any(changes)


def is_scant(findings: Mapping[str, Any]) -> bool:
    """Return whether a law is not confirmed because the readings are too few to prove it."""
    return bool(findings["fit"].get("unconfirmed") == "few-readings")


def contradictions(findings: Mapping[str, Any]) -> list[str]:
    """Return why an explanation is not confirmed."""
    if is_confirmed(findings):
        return []
    if not findings["terms"]:
        return [_contradicted_faults(findings["fit"])]
    if is_scant(findings):
        return [_too_few(findings)]
    return [_contradiction(each) for each in findings["fit"]["comparisons"] if each["worse"]]


def _too_few(findings: Mapping[str, Any]) -> str:
    """Return that many laws fit so few readings."""
    fit, terms = findings["fit"], findings["terms"]
    fitted = plural(len(terms), "coefficient")
    if fit["start_values"]:
        fitted = f"{fitted} and {plural(fit['start_values'], 'start value')}"
    verb = "was" if len(terms) == 1 and not fit["start_values"] else "were"
    return (
        f"{fitted} {verb} fitted to {fit['readings']} readings. Other laws with the same number of "
        "terms also fit so few readings. Record more readings, or restrict library to the terms "
        "that are possible."
    )


def _contradicted_faults(fit: Mapping[str, Any]) -> str:
    """Return why not only sensors err."""
    likely = "This is not the case: an effect that the simulation lacks is more likely."
    if fit.get("unconfirmed") == "no-better-than-mean":
        return (
            "If only these sensors were faulty, the simulation would predict the others better "
            f"than their mean does. {likely}"
        )
    misfits = fit["misfit_at_test_sensors"] or {}
    each = ", ".join(f"{error_text(misfit)} at {name}" for name, misfit in misfits.items())
    told = f" Errors in standard deviations of the fit's residuals: {each}." if each else ""
    return (
        "If only these sensors were faulty, the simulation would agree with the sensors that no "
        "fit has used, unless one of them is faulty too and not next to a faulty sensor of the "
        f"fit. {likely}{told}"
    )


def _contradiction(compared: Mapping[str, Any]) -> str:
    before, after, error = (compared[key] for key in ("before", "after", "error"))
    line = (
        f"{HELD_OUT[compared['data']]} the error is {error_text(after)} with the suggested law, "
        f"and {error_text(before)} for the simulation from its best start."
    )
    if error is None:
        return line
    difference = compared["difference"]
    size, low, high = (
        rounded(value, error)[0] for value in (difference, difference - error, difference + error)
    )
    return f"{line} The mean squared error is larger by {size} (99 % interval: {low} to {high})."
