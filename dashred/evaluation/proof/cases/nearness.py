"""How near a case's law came to what was hidden: its window, its coefficients, its gains."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import xarray as xr

from dashred.core.findings.schema import Score
from dashred.data.observation_operator import ObservationOperator
from dashred.evaluation.benchmark.record import ratio_of
from dashred.evaluation.proof.cases.case_record import Coefficient, Gains, Region
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.effect_size import Concealed
from dashred.evaluation.twins.scoring import law_of_findings, law_of_truth
from dashred.evaluation.twins.window_kinds import WindowKind, kind_of

# Times that differ by less are the same.
CLOCK = 1e-9
# Of an error that is not finite.
ENDLESS = 1e6


def region_off(score: Score, findings: Mapping[str, Any], concealed: Concealed) -> Region | None:
    """Return how well the window was found, in shares.

    Where is a question of its own; when, and in which states, are asked of the hidden term, as its
    coefficient is: another one begins elsewhere to do the same.
    """
    found = score["region"]
    if found is None:
        return None
    truth = concealed.truth
    [window] = [t.window for t in truth.terms if t.window is not None]
    exact = score["exact_support"]
    threshold, share, z = found["threshold"], None, None
    if exact and threshold is not None:
        field = concealed.system.fields.index(window[0])
        values = truth.states[truth.times <= truth.duration, field]
        share = threshold / float(values.max() - values.min())
        [region] = next(e["region"] for e in findings["terms"] if e.get("region"))
        z = threshold / region["std"] if region.get("std") else None
    onset = found["onset"] if exact else None
    return {
        "overlap": found["overlap"],
        "onset": None if onset is None else onset / truth.duration,
        "threshold": share,
        "threshold_z": z,
    }


def peak_inside(case: Case, findings: Mapping[str, Any], concealed: Concealed) -> bool | None:
    """Return whether the map of a free forcing is largest where the hidden law acts."""
    where = findings["where"]
    if case.kind != "box" or where is None or where["forcing"] is None:
        return None
    [peak] = where["forcing"]["peak"]
    [window] = [t.window for t in concealed.truth.terms if t.window is not None]
    _, begin, end, _ = window
    assert begin is not None and end is not None
    return bool(begin <= peak <= end)


def coefficients_found(findings: Mapping[str, Any], concealed: Concealed) -> list[Coefficient]:
    """Return found and true coefficients of a law whose form is exact."""
    truth = concealed.truth
    found: list[Coefficient] = []
    for entry in findings["terms"]:
        if entry["equation"] is None:
            name, known = entry["parameter"], entry["from"]
            true = truth.concealed.parameters.get(name)
            # The change is what was found: the old value was known.
            true = None if true is None else true - known
        else:
            name, known = f"{entry['equation']}: {entry['term']}", 0.0
            mine = law_of_findings({**findings, "terms": [{**entry, "coefficient": 1.0}]})
            [key] = mine
            theirs = law_of_truth(findings, truth.terms, truth.concealed.parameters)
            true = theirs[key] / mine[key]
        if true is not None:
            window = next((t.window for t in truth.terms if t.window is not None), None)
            low, high = entry["ci95"]
            found.append(
                {
                    "name": name,
                    "true": true,
                    "found": entry["coefficient"],
                    "std": entry["std"],
                    "covered": low is not None and low <= known + true <= high,
                    "window": _window_name(kind_of(window)),
                }
            )
    return found


def _window_name(kind: WindowKind | None) -> Literal["box", "gate", "onset"] | None:
    if kind is None:
        return None
    if kind.side is not None:
        return "gate"
    return "onset" if kind.of == "t" else "box"


def gains(
    case: Case,
    findings: Mapping[str, Any],
    concealed: Concealed,
    folder: Path,
    score: Score,
) -> Gains | None:
    """Return by how much the law brought the simulation nearer to the truth without noise."""
    if not findings["terms"] or case.kind in ("null", "start", "fault", "numerics"):
        return None
    truth, system = concealed.truth, concealed.system
    names = findings["input"]["splits"]["test"]
    sensors = [s for s in concealed.recording.sensors if s.name in names]
    operator = ObservationOperator(sensors, system)
    with xr.open_dataset(folder / "estimates.nc", engine="h5netcdf") as estimates:
        at = np.searchsorted(truth.times.numpy(), estimates["time"].values - CLOCK)
        real = operator(truth.states[at])
        errors = {}
        for method in ("simulation_same_start", "simulation_refit", "corrected"):
            chosen = estimates.sel({"method": method})
            states = np.stack([chosen[field].values for field in system.fields], axis=1)
            wrong = operator(torch.from_numpy(states)) - real
            errors[method] = float(wrong.square().mean().sqrt())
    beyond, after = score["forecast"], errors["corrected"]
    return {
        "test_sensors": ratio_of(errors["simulation_refit"], after),
        "forecast": ratio_of(beyond["simulation_refit"], beyond["corrected"]),
        "test_sensors_before": ratio_of(errors["simulation_same_start"], after),
        "forecast_before": ratio_of(beyond["simulation_same_start"], beyond["corrected"]),
    }


def noisy_test(findings: Mapping[str, Any]) -> float | None:
    """Return by what share the corrected simulation is worse on the noisy data held out."""
    known = findings["fit"]["test_sensors"] if findings["fit"] else {}
    before, after = known.get("simulation_refit"), known.get("corrected")
    if before is not None and after is None and findings["terms"]:
        return ENDLESS
    ratio = ratio_of(after, before)
    return None if ratio is None else ratio - 1
