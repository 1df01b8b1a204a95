"""The errors on held-out data with and without the law, in plain sentences."""

from collections.abc import Mapping
from typing import Any

from dashred.core.findings.fit_schema import LARGEST_OWN_ERROR
from dashred.core.formatting import number, plural
from dashred.core.units import NO_UNITS, TIME, with_unit

# A run whose error, in standard deviations of the readings, is larger than this has diverged.
HUGE = 1e4
# A ratio of errors nearer to 1 than this counts as no difference.
SAME = 0.95
# Verdicts for a simulator that is given as snapshots: no law was fitted through it.
UNTESTED = ("mismatch", "no-mismatch-seen")
# Verdicts whose correction is a start or a sensor.
OTHER_CAUSES = ("initial-condition", "sensor-fault")
# Fewer held-out samples are little evidence.
FEW_SAMPLES = 10
HELD_OUT = {
    "test_sensors": "At the test sensors",
    "heldout_time": "In the held-out time",
    "heldout_restarted": "In the held-out time, from a state fitted just before it,",
    "heldout_episode": "In the held-out episode",
}


def error_before(findings: Mapping[str, Any], key: str) -> float | None:
    """Return the error that the corrected simulation is compared with on some held-out data.

    It is the smaller error of the simulation from the start of the correction and from its own best
    start, with fitted parameters if there are any. If the start or the parameters themselves are
    the correction, it is that of the simulation as it is stated. It is None if the run diverges.
    """
    errors: Mapping[str, float | None] = findings["fit"].get(key) or {}
    same_start, refit = (errors.get(f"simulation_{name}") for name in ("same_start", "refit"))
    if key == "heldout_restarted":
        # After a restart, the start of the recording has no effect.
        return refit
    if findings["verdict"] == "initial-condition" or has_only_parameters(findings):
        return same_start
    return min((error for error in (same_start, refit) if error is not None), default=None)


def has_only_parameters(findings: Mapping[str, Any]) -> bool:
    """Return whether fitted parameters are all that was corrected."""
    return findings["verdict"] == "nothing-missing" and bool(findings.get("fitted_parameters"))


def improvements(findings: Mapping[str, Any]) -> list[str]:
    """Return the errors of the corrected simulation, and of the simulation from both starts."""
    lines, verdict, fit = [], findings["verdict"], findings["fit"]
    samples = fit.get("held_out_samples", {})
    start = "the same start" if findings["terms"] else "its nominal start"
    best = "its best start"
    if findings.get("fitted_parameters"):
        best += " with the fitted parameters"
    if verdict == "initial-condition":
        best += " under the stated prior"
    for key, place in HELD_OUT.items():
        errors = fit.get(key) or {}
        names = ("simulation_same_start", "simulation_refit", "corrected")
        same_start, refit, corrected = (errors.get(name) for name in names)
        if refit is None and corrected is None:
            continue
        if has_only_parameters(findings) and same_start is None:
            # Nothing else was corrected, so there is nothing to compare with.
            continue
        parts = [f"{error_text(corrected)} for the corrected simulation"]
        if not has_only_parameters(findings):
            parts.insert(0, f"{error_text(refit)} for the simulation from {best}")
        if same_start is not None:
            parts.insert(0, f"{error_text(same_start)} for the simulation from {start}")
        change = _factor(error_before(findings, key), corrected)
        if findings["terms"] and is_lost(fit, key):
            change = "this chaotic system is not predictable that far ahead"
        lines.append(
            f"{place} the error is {', '.join(parts)}: {change}.{_predictable(findings, key)}"
            f"{_little_evidence(samples.get(key))}"
        )
    return lines


def is_lost(fit: Mapping[str, Any], key: str) -> bool:
    """Return whether runs of a chaotic system are lost before these held-out data begin.

    They are then not compared there, although they are compared elsewhere. If the law alone makes
    the run diverge, it is not lost by chaos.
    """
    compared = [each["data"] for each in fit.get("comparisons", ())]
    errors = fit.get(key) or {}
    before = [errors.get(f"simulation_{start}") for start in ("same_start", "refit")]
    is_unstable = _diverges(errors.get("corrected")) and not all(map(_diverges, before))
    return bool(compared) and key not in compared and not is_unstable


def _predictable(findings: Mapping[str, Any], key: str) -> str:
    """Return the errors up to the time at which both runs of a chaotic system are lost."""
    for each in findings["fit"].get("comparisons", ()):
        if each["data"] == key and each["horizon"] is not None:
            before, after = each["before"], each["after"]
            horizon = with_unit(f"{each['horizon']:.3g}", findings.get("units", NO_UNITS).get(TIME))
            return (
                " The error of a run grows until the run is no longer predictive. In the first "
                f"{horizon} of a run the error is {error_text(before)} from the best start and "
                f"{error_text(after)} with the correction: {_factor(before, after)}."
            )
    return ""


def resolution_warning(fit: Mapping[str, Any]) -> list[str]:
    """Return what to do if the simulator fails, or errs by more than the residuals at the start."""
    error, failed = fit["own_error"], []
    if fit.get("failure"):
        failed = [
            f"The simulator: {fit['failure']}. A run that reaches such a step ends there, and no "
            "error is given for it."
        ]
    if error is None or error <= 1:
        return failed
    size, dt = number(float(f"{error:.2g}")), fit.get("sufficient_dt")
    remedy = "halve the time step or double the points"
    if dt is not None:
        remedy = f"set system.integrator.dt to {number(float(f'{dt:.6g}'))}"
    if error >= LARGEST_OWN_ERROR:
        return [
            *failed,
            "At the start of the recording, either the corrected simulation or the same simulation "
            "with half the time step does not stay finite. A term that acts only there may be an "
            f"artefact of this. To check, {remedy}, and run again.",
        ]
    return [
        *failed,
        "At the start of the recording, the numerical error of the corrected simulation is "
        f"{size} times the residuals of the fit. The resolution was checked before the law was "
        "known. A term that acts only there may be an artefact of this error. To check, "
        f"{remedy}, and run again.",
    ]


def forecast_limits(findings: Mapping[str, Any]) -> list[str]:
    """Return where the forecast ends because the law diverges, and the step that the law needs."""
    fit, units, lines = findings["fit"], findings.get("units", NO_UNITS), []
    if (diverges := fit.get("diverges")) is not None:
        time = with_unit(f"{diverges:.4g}", units.get(TIME))
        lines.append(
            f"The corrected simulation diverges at t = {time}, also with shorter time steps: the "
            "law itself diverges. There is no forecast after this time."
        )
    if (dt := fit.get("corrected_dt")) is not None:
        step = with_unit(number(float(f"{dt:.6g}")), units.get(TIME))
        lines.append(
            "With the law, the time step of the simulation is unstable. corrected.yaml has a time "
            f"step of {step}, and the forecast was made with it."
        )
    return lines


def assimilation_gains(findings: Mapping[str, Any]) -> list[str]:
    """Return what assimilation improves, for a simulator that is given as snapshots."""
    if findings["verdict"] not in UNTESTED:
        return []
    lines = []
    for key, place in HELD_OUT.items():
        errors = findings["fit"].get(key) or {}
        shred, dashred = errors.get("shred_plain"), errors.get("dashred")
        if shred is None or dashred is None:
            continue
        nearest = errors.get("nearest_snapshots")
        parts = [f"{nearest:.3g} with the nearest snapshots"] if nearest is not None else []
        parts += [f"{shred:.3g} with SHRED", f"{dashred:.3g} with DA-SHRED"]
        gain = "DA-SHRED equals SHRED, because its validation sensors confirmed no change"
        if shred != dashred:
            gain = f"{_factor(shred, dashred)} after assimilation"
        lines.append(f"{place} the error is {', '.join(parts)}: {gain}.")
    return lines


def count_text(samples: int | None) -> str:
    """Return a number of held-out samples for the head of a table: `` (44 samples)``."""
    return "" if samples is None else f" ({plural(samples, 'sample')})"


def _little_evidence(samples: int | None) -> str:
    if samples is None or samples >= FEW_SAMPLES:
        return ""
    noun = "sample is" if samples == 1 else "samples are"
    return f" {samples} held-out {noun} little evidence."


def _diverges(error: float | None) -> bool:
    """Return whether a run has a huge error, or none: null stands for one that blows up."""
    return error is None or not error <= HUGE


def error_text(error: float | None) -> str:
    """Return an error; a run that blows up has none, and null stands for it in the findings."""
    if error is None or _diverges(error):
        return "beyond all bounds"
    return f"{error:.3g}"


def _factor(before: float | None, after: float | None) -> str:
    lost = [_diverges(error) for error in (before, after)]
    if before is None or after is None or any(lost):
        if all(lost):
            return "both runs diverge"
        return f"the run {'without' if lost[0] else 'with'} the law diverges"
    if after <= 0 or before <= 0:
        return "the factor is undefined"
    ratio = before / after
    if SAME < ratio < 1 / SAME:
        return "no difference"
    size = number(float(f"{max(ratio, 1 / ratio):.2g}"))
    return f"{size} times {'smaller' if ratio > 1 else 'larger'}"
