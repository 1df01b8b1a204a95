"""The findings of an analysis of snapshots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dashred.core.files.atomic import write_netcdf_atomic
from dashred.core.findings.cause_schema import Cause, Verdict
from dashred.core.findings.fit_schema import Fit, errors_by_method
from dashred.core.findings.schema import Findings, Latent, new_findings
from dashred.data.recording import Recording
from dashred.pipeline.outputs.field_files import fields_dataset
from dashred.pipeline.problem import Problem
from dashred.pipeline.snapshots.black_box_analysis import BlackBoxAnalysis, full_record
from dashred.pipeline.snapshots.mismatch import ErrorComparison
from dashred.pipeline.verification.findings_files import freeze_findings
from dashred.pipeline.verification.findings_input import build_input
from dashred.pipeline.verification.held_out import relative_rmse
from dashred.pipeline.verification.spent_budget import note_budget
from dashred.pipeline.verification.verification import proposals
from dashred.reporting.text.causes import limits_of_snapshots
from dashred.reporting.wording.findings_text import add_text


def verify(problem: Problem, analysis: BlackBoxAnalysis) -> Findings:
    """Compare the methods with the held-out data and return the findings."""
    proposed = {n: proposals(problem, fit) for n, fit in analysis.assimilated.proposals.items()}
    kind: Verdict = "mismatch" if analysis.compared.seen else "no-mismatch-seen"
    source = build_input(problem)
    source["snapshots_sha256"] = analysis.runs.sha256
    findings = new_findings(
        source,
        fit=Fit(
            comparisons=[],
            noise_std=problem.noise,
            noise_correlation=None,
            own_error=None,
            chi2=None,
            unexplained=None,
            misfit_at_test_sensors=None,
            test_sensors=errors_by_method(**_test_errors(problem, analysis)),
            heldout_time=errors_by_method(**_heldout_errors(problem, analysis)),
            heldout_restarted=errors_by_method(),
        ),
        latent=Latent(alg1=proposed["alg1"], alg2=proposed["alg2"]),
        verdict=kind,
        causes=[_cause(kind, analysis)],
        units=problem.system.units,
    )
    note_budget(findings, problem.budget)
    return add_text(findings, problem.system)


def write(problem: Problem, analysis: BlackBoxAnalysis, findings: Findings, output: Path) -> None:
    """Write and freeze the fields over the full record and the findings."""
    write_netcdf_atomic(output / "estimates.nc", estimates_dataset(problem, analysis))
    freeze_findings(output, findings, ["estimates.nc"])


def estimates_dataset(problem: Problem, analysis: BlackBoxAnalysis) -> xr.Dataset:
    """Return the fields by method, up to the shortest of them."""
    reach = min(len(states) for states in analysis.fields.values())
    fields = {name: states[:reach] for name, states in analysis.fields.items()}
    return fields_dataset(problem.system, problem.times[:reach], fields)


def _cause(kind: Verdict, analysis: BlackBoxAnalysis) -> Cause:
    compared, steps = analysis.compared, analysis.steps
    increments_error = {str(n): error for n, error in sorted(steps.errors.items())}
    return {
        "kind": kind,
        "probability": None,
        "where": None,
        "states": _numbers(compared.states),
        "changes": _numbers(compared.changes) | {"samples": compared.samples},
        "increments_error": increments_error,
        "cannot_know": limits_of_snapshots(increments_error),
    }


def _numbers(missed: ErrorComparison) -> dict[str, Any]:
    return {
        "p": missed.p,
        "error": missed.error,
        "usual": missed.usual.tolist(),
        "sensors": missed.sensors,
    }


def _test_errors(problem: Problem, analysis: BlackBoxAnalysis) -> dict[str, float]:
    split = problem.split
    tested = split.tested.between(float(problem.times[0]), split.time_end)
    return _errors(problem, analysis, tested, 0)


def _heldout_errors(problem: Problem, analysis: BlackBoxAnalysis) -> dict[str, float]:
    """Return the errors at sensors that are not input of SHRED."""
    split, count = problem.split, len(problem.split.fit.times)
    if split.test:
        late = split.tested.between(float(problem.times[count]), float(problem.times[-1]))
    else:
        others = [name for name in split.heldout.names if name not in split.inputs]
        late = split.heldout.select(others)
    return _errors(problem, analysis, late, count)


def _errors(
    problem: Problem, analysis: BlackBoxAnalysis, recorded: Recording, begin: int
) -> dict[str, float]:
    if not recorded.sensors:
        return {}
    operator, names = problem.operator(recorded), recorded.names
    split, end = problem.split, begin + len(recorded.times)
    if split.test:
        earlier = split.tested.between(float(problem.times[0]), split.time_end)
    else:
        earlier = full_record(problem, names).between(float(problem.times[0]), split.time_end)
    scale: np.ndarray = earlier.trace_scale()
    return {
        name: relative_rmse(operator(states[begin:end]).numpy(), recorded.values, scale)
        for name, states in analysis.fields.items()
        if len(states) >= end
    }
