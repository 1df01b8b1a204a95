"""A cause of the verdict, as text."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dashred.core.findings.cause_schema import Cause
from dashred.core.formatting import number, percent, plural
from dashred.core.units import NO_UNITS
from dashred.reporting.text.sensor_faults import fault_text

EXTENDED = (
    "no law of the library explains the recording, but a law of the extended library does. That "
    "library also contains functions, higher powers and waves in space or time"
)
LEAST_CHANCE = 0.001
# A less probable cause is not reported.
LIKELY = 0.05
# Residuals larger than the noise by less than this factor count as noise, which is an estimate.
NOISE_RATIO = 1.2
LIMITS_OF_SNAPSHOTS = (
    "The simulator is known by its snapshots alone, so no law could be fitted to the sensors "
    "through it. The terms that latent SINDy proposes are untested, and have no intervals",
    "A missing term, a wrong parameter, a start outside its prior and a faulty sensor cannot be "
    "distinguished",
    "The resolution of the simulation could not be checked. Its numerical error may be part of "
    "what is seen",
    "SHRED was trained on the snapshots as they are, not on simulations with random "
    "discrepancies, so it can hardly represent what no snapshot contains",
    "There is no simulator to run, so there is no corrected simulation and no forecast. In the "
    "held-out time the field is estimated from the readings of SHRED's sensors at that time",
)


def cause_text(cause: Cause, units: Mapping[str, str] = NO_UNITS) -> str | None:
    """Return the cause in one sentence; None where its terms or parameters describe it.

    Args:
        cause: of the findings.
        units: by name.
    """
    match cause["kind"]:
        case "sensor-fault":
            return fault_text(cause, units)
        case "initial-condition":
            factor = f"{cause['start']:g}"
            return (
                "the initial state lies outside its prior, at a distance of about "
                f"{factor} standard deviations of the prior"
            )
        case "not-converged":
            return _not_converged(cause)
        case "unresolved-numerics":
            return _unresolved(cause)
        case "mismatch" | "no-mismatch-seen":
            return _mismatch(cause)
        case "outside-library" if "gain" in cause:
            gain = cause["gain"]
            # Without a run that stays finite there is no number.
            size = f"is {gain:.3g}" if math.isfinite(gain) else "is large"
            ratio = noise_ratio(cause.get("unexplained", 0.0), cause.get("misfit", 1.0))
            if ratio < NOISE_RATIO:
                return f"the evidence for a force beyond the best law with a few terms {size}"
            return (
                "the best law with a few terms leaves residuals of "
                f"{number(float(f'{ratio:.2g}'))} times the noise, and the evidence for a force "
                f"beyond it {size}"
            )
        case "outside-library" if "residual" in cause:
            return (
                f"the best law leaves residuals of {cause['residual']:.2g} standard deviations of "
                f"the readings; {percent(cause['unexplained'])} of this misfit is neither the "
                "stated noise nor noise that is visible in the traces. The given law is only the "
                "nearest"
            )
        case "outside-library" if "supported" in cause:
            further = cause["supported"]
            return (
                f"the given law leaves {cause['misfit']:.3g} times the mean squared misfit of the "
                f"law with {further} further {'term' if further == 1 else 'terms'}. It is only the "
                "nearest of its size"
            )
        case "outside-library" if "source" in cause:
            return "no law of the library explains the recording, but a localised source does"
        case "outside-library" if "hidden_state" in cause:
            return (
                "no law of the library explains the recording, but a law with a hidden state does"
            )
        case "outside-library":
            return EXTENDED
    return None


def noise_ratio(unexplained: float, misfit: float) -> float:
    """Return the residuals of the given law in units of the noise of the recording.

    Args:
        unexplained: share of the misfit of the largest fitted law that is not noise.
        misfit: χ²/n of the given law, relative to the residuals of the largest; it does not count
            if the law's run blows up.
    """
    relative = max(misfit, 1.0) if math.isfinite(misfit) else 1.0
    return math.sqrt(relative / max(1 - unexplained, 1e-12))


def fault_causes(causes: Sequence[Cause]) -> list[Cause]:
    """Return the sensor faults that are more probable than not; they may be beside a law."""
    return [c for c in causes if c["kind"] == "sensor-fault" and (c["probability"] or 0) > 0.5]


def limits_of_snapshots(increments_error: Mapping[str, float]) -> list[str]:
    """Return what an analysis of snapshots cannot determine.

    Args:
        increments_error: of the learned steps on unseen snapshots, by number of samples.
    """
    errors = ", ".join(f"{100 * e:.1f} % over {n} samples" for n, e in increments_error.items())
    learned = (
        "The simulator's steps were learned from the increments of the snapshots. On unseen "
        f"snapshots their error is {errors}"
    )
    return [*LIMITS_OF_SNAPSHOTS, learned]


def _not_converged(cause: Cause) -> str:
    match cause["reason"]:
        case "window-not-reached":
            return (
                f"the simulation could be fitted only to the first {cause['samples']} of "
                f"{cause['samples_in_all']} samples (misfit {cause['misfit']:.3g})"
            )
        case "law-not-fitted":
            return (
                f"the misfit of the best law is {cause['misfit']:.3g}, but all candidates together "
                f"reach {cause['misfit_of_all']:.3g}: no sparse law was fitted to convergence"
            )
        case "law-incomplete":
            chance, least = cause["chance"], LEAST_CHANCE
            size = f"below {percent(least)}" if chance < least else f"of {percent(chance)}"
            return (
                f"the fit of the best law ended with a misfit of {cause['misfit']:.3g}, but all "
                f"candidates together reach {cause['misfit_of_all']:.3g}. Noise alone gives such a "
                f"difference with a probability {size}, so something may be missing that no law of "
                "few terms expresses"
            )
        case "budget":
            return (
                "a part of the search reached the end of its share of the budget of "
                f"{cause['budget']:g} s. To allow more time, set budget=SECONDS"
            )
    return (
        f"no tested cause explains the recording: {percent(cause['unexplained'])} of the misfit "
        "is neither the stated noise nor noise that is visible in the traces"
    )


def _unresolved(cause: Cause) -> str:
    if not math.isfinite(cause["doubling_error"]):
        return (
            "at doubled resolution the simulation blows up: it may amplify short waves without "
            "bound. Add the dissipation that is known, or use a shorter time step"
        )
    advice = "doubling it twice is not enough"
    if cause["enough"] is not None:
        points = " and ".join(f"{n} points along {axis}" for axis, n in cause["enough"].items())
        advice = " with ".join(filter(None, [points, "half the time step"])) + " would be enough"
    return (
        f"doubling the resolution changes a sensor trace by {100 * cause['doubling_error']:.1f} % "
        f"of its standard deviation, above the limit of {100 * cause['limit']:.1f} %; {advice}"
    )


def _mismatch(cause: Cause) -> str:
    text = (
        "At the sensors of the recording, the error of SHRED, trained on the snapshots alone, is "
        f"{_missed(cause['states'])}. The error of the learned steps in the change over "
        f"{plural(cause['changes']['samples'], 'sample')} is {_missed(cause['changes'])}"
    )
    if cause["kind"] == "no-mismatch-seen":
        text += (
            ". The recording is within the range of the snapshots. Something that the snapshots do "
            "not show may still be missing"
        )
    return text


def _missed(errors: Mapping[str, Any]) -> str:
    usual = errors["usual"]
    stretches = "stretch" if len(usual) == 1 else "stretches"
    return (
        f"{errors['error']:.3g} standard deviations, compared with {min(usual):.3g} to "
        f"{max(usual):.3g} in {len(usual)} unseen {stretches} of the snapshots"
    )


def reported_causes(findings: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the leading cause and the faulty sensors; if ambiguous, all probable causes."""
    known = findings["causes"] or []
    if findings["verdict"] != "ambiguous":
        return [*known[:1], *fault_causes(known[1:])]
    return [cause for cause in known if cause["probability"] >= LIKELY]
