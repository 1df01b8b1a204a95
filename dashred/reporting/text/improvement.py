"""What a fit is worth, in plain sentences: errors before and after, on what no fit has seen."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import number

# Verdicts of a simulator that was given as snapshots: nothing has been fitted through it.
UNTESTED = ("mismatch", "no-mismatch-seen")
PROOFS = {
    "test_sensors": "At the test sensors",
    "heldout_time": "In the held-out time",
    "heldout_restarted": "From a state fitted just before it",
    "heldout_episode": "In an episode held out whole",
}


def worth(fit: Mapping[str, Any]) -> list[str]:
    """How much the fit improves, against both uncorrected simulations."""
    lines = []
    for key, place in PROOFS.items():
        errors = fit.get(key, {})
        before, refit, after = (
            errors.get(k) for k in ("simulation_same_start", "simulation_refit", "corrected")
        )
        if refit is None or after is None:
            continue
        path = [f"{refit:.3g} with the simulation's own best start", f"{after:.3g} after"]
        if before is not None:
            path.insert(0, f"{before:.3g} before")
        lines.append(f"{place} the error is {', '.join(path)}: {_factor(refit, after)}.")
    return lines


def unresolved(fit: Mapping[str, Any]) -> list[str]:
    """What to do where the simulator's own error is above the noise as the recording begins."""
    error = fit["own_error"]
    if error is None or error <= 1:
        return []
    size = number(float(f"{error:.2g}"))
    return [
        f"Where the recording begins, the simulation's own numerical error is {size} times the "
        "sensors' noise, and what acts at such values alone may be that error: halve the time "
        "step, or double the points, and run again."
    ]


def reconstructed(findings: Mapping[str, Any]) -> list[str]:
    """What assimilation is worth, where the simulator is known by snapshots alone."""
    if findings["verdict"] not in UNTESTED:
        return []
    lines = []
    for key, place in PROOFS.items():
        errors = findings["fit"].get(key) or {}
        before, after = errors.get("shred_plain"), errors.get("dashred")
        if before is None or after is None:
            continue
        nearest = errors.get("nearest_snapshots")
        path = [f"{nearest:.3g} with the nearest snapshots"] if nearest is not None else []
        path += [f"{before:.3g} with SHRED", f"{after:.3g} with DA-SHRED"]
        gain = "DA-SHRED is SHRED, as its validation sensors confirmed no change"
        if before != after:
            gain = f"assimilation makes it {_factor(before, after)}"
        lines.append(f"{place} the error is {', '.join(path)}: {gain}.")
    return lines


def _factor(before: float, after: float) -> str:
    if after <= 0 or before <= 0:
        return "no factor can be given"
    ratio = before / after
    if 0.95 < ratio < 1.05:
        return "no difference"
    size = number(float(f"{max(ratio, 1 / ratio):.2g}"))
    return f"{size} times {'smaller' if ratio > 1 else 'larger'}"
