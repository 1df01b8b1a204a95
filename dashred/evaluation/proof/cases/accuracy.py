"""Accuracy of the law of a case: its window, its coefficients and its gains."""

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
from dashred.evaluation.proof.cases.effect_size import CaseTruth
from dashred.evaluation.twins.scoring import law_of_findings, law_of_truth
from dashred.evaluation.twins.window_kinds import WindowKind, window_kind

# Largest difference of equal times.
TIME_TOLERANCE = 1e-9
# Ratio that stands for an error that is not finite.
INFINITE_RATIO = 1e6


def region_errors(
    score: Score, findings: Mapping[str, Any], case_truth: CaseTruth
) -> Region | None:
    """Return the relative errors of the window.

    Onset and threshold are compared only if the support is exact: another term needs another onset
    or threshold to have the same effect.
    """
    found = score["region"]
    if found is None:
        return None
    truth = case_truth.truth
    [window] = [t.window for t in truth.terms if t.window is not None]
    exact = score["exact_support"]
    threshold, share, z = found["threshold"], None, None
    if exact and threshold is not None:
        field = case_truth.system.fields.index(window[0])
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


def peak_inside(case: Case, findings: Mapping[str, Any], case_truth: CaseTruth) -> bool | None:
    """Return whether the peak of the free forcing lies in the region of the hidden law."""
    where = findings["where"]
    if case.kind != "box" or where is None or where["forcing"] is None:
        return None
    [peak] = where["forcing"]["peak"]
    [window] = [t.window for t in case_truth.truth.terms if t.window is not None]
    _, begin, end, _ = window
    assert begin is not None and end is not None
    return bool(begin <= peak <= end)


def coefficients_found(findings: Mapping[str, Any], case_truth: CaseTruth) -> list[Coefficient]:
    """Return the estimated and true coefficients of a law whose form is exact."""
    truth = case_truth.truth
    found: list[Coefficient] = []
    for entry in findings["terms"]:
        if entry["equation"] is None:
            name, known = entry["parameter"], entry["from"]
            true = truth.concealed.parameters.get(name)
            # The coefficient is the change of the parameter.
            true = None if true is None else true - known
        else:
            name, known = f"{entry['equation']}: {entry['term']}", 0.0
            found_law = law_of_findings({**findings, "terms": [{**entry, "coefficient": 1.0}]})
            [key] = found_law
            true_law = law_of_truth(findings, truth.terms, truth.concealed.parameters)
            true = true_law[key] / found_law[key]
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
                    "window": _window_name(window_kind(window)),
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
    case_truth: CaseTruth,
    folder: Path,
    score: Score,
) -> Gains | None:
    """Return the error ratios of the simulation without and with the law, against the truth."""
    if not findings["terms"] or case.kind in ("null", "start", "fault", "numerics"):
        return None
    truth, system = case_truth.truth, case_truth.system
    names = findings["input"]["splits"]["test"]
    sensors = [s for s in case_truth.recording.sensors if s.name in names]
    operator = ObservationOperator(sensors, system)
    with xr.open_dataset(folder / "estimates.nc", engine="h5netcdf") as estimates:
        at = np.searchsorted(truth.times.numpy(), estimates["time"].values - TIME_TOLERANCE)
        real = operator(truth.states[at])
        errors = {}
        for method in ("simulation_same_start", "simulation_refit", "corrected"):
            chosen = estimates.sel({"method": method})
            states = np.stack([chosen[field].values for field in system.fields], axis=1)
            error = operator(torch.from_numpy(states)) - real
            errors[method] = float(error.square().mean().sqrt())
    beyond, after = score["forecast"], errors["corrected"]
    return {
        "test_sensors": ratio_of(errors["simulation_refit"], after),
        "forecast": ratio_of(beyond["simulation_refit"], beyond["corrected"]),
        "test_sensors_before": ratio_of(errors["simulation_same_start"], after),
        "forecast_before": ratio_of(beyond["simulation_same_start"], beyond["corrected"]),
    }


def noisy_test_change(findings: Mapping[str, Any]) -> float | None:
    """Return the relative increase of the error on noisy held-out data due to the correction."""
    known = findings["fit"]["test_sensors"] if findings["fit"] else {}
    before, after = known.get("simulation_refit"), known.get("corrected")
    if before is not None and after is None and findings["terms"]:
        return INFINITE_RATIO
    ratio = ratio_of(after, before)
    return None if ratio is None else ratio - 1
