"""Run the rows: record a twin, analyse it, and compare its estimators with a filter."""

from __future__ import annotations

import json
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dashred.core.findings.findings import check_freeze
from dashred.evaluation.case_rows import Case, run_cases
from dashred.evaluation.concealed_twin import RECORDING, SEALED, record_concealed
from dashred.evaluation.estimators.arguments import BENCHMARK, Request
from dashred.evaluation.estimators.rows import Errors, Row, ratio
from dashred.evaluation.estimators.true_filter import filter_truth
from dashred.evaluation.isolation.analysis import FOUND, GIVEN, Analysis, analyse
from dashred.evaluation.twins.findings_reader import read_findings
from dashred.evaluation.twins.score_command import load_fields, true_states
from dashred.evaluation.twins.scoring import field_scale, rmse, scaled_errors, score_law
from dashred.evaluation.twins.sealing import open_seal
from dashred.pipeline.observer import STEP
from dashred.pipeline.verification.findings_files import SPREAD

Array = NDArray[np.float64]

# Half-width of a 90 % band in standard deviations.
Z90 = 1.645


def run_estimators(request: Request) -> None:
    """Run the rows of a request that are not done."""
    run_cases(request, request.output, BENCHMARK, partial(_run_case, request), _told)


def _run_case(request: Request, case: Case) -> Row:
    """Return the row of a case. The analysis is a process of its own that sees the recording."""
    with tempfile.TemporaryDirectory(prefix="dashred-estimators-") as name:
        folder, found = Path(name) / "case", Path(name) / "findings"
        # While the analysis runs, the truth is in the memory of this process alone.
        sealed = record_concealed(case, request.noise, folder)
        common = [f"conf={case.system}", f"seed={case.seed}", "threads=1"]
        words = [*common, f"recording.path={GIVEN}/{RECORDING}", f"output={FOUND}"]
        if request.budget is not None:
            words.append(f"budget={request.budget}")
        files = {RECORDING: (folder / RECORDING).read_bytes()}
        answer = analyse(Analysis(files, tuple(words), float(request.limit)))
        row = _empty_row(request, case, answer.problem)
        if answer.problem is not None:
            return row
        answer.write(found, Path(name) / "log.txt")
        check_freeze(found)
        (folder / SEALED).write_bytes(sealed)
        own = [*common, f"recording.path={folder / RECORDING}", f"output={Path(name) / 'none'}"]
        filtered, settings = filter_truth(own, case.twin, request.members)
        return row | _scores(folder / SEALED, found, filtered) | {"filter_settings": settings}


def _empty_row(request: Request, case: Case, problem: str | None) -> Row:
    return Row(
        system=case.system,
        twin=case.twin,
        seed=case.seed,
        noise=request.noise,
        budget=request.budget,
        verdict=None,
        exact=None,
        problem=problem,
        filter=None,
        filter_settings="",
        shred=None,
        observer=None,
        covered=None,
        milliseconds=None,
    )


def _scores(sealed: Path, found: Path, filtered: Array | None) -> Row:
    """Return what the truth says of frozen findings and of the filter."""
    findings = read_findings(found)
    truth, fields = open_seal(sealed)
    estimates = load_fields(found / "estimates.nc")
    true = true_states(estimates, truth, fields, sealed)
    errors = scaled_errors(estimates, true, fields)
    exact, _ = score_law(findings, truth.terms, truth.concealed.parameters)
    scores = Row(  # type: ignore[typeddict-item]
        verdict=findings["verdict"],
        exact=exact,
        shred=_errors(errors["corrected_shred"]),
    )
    scale = field_scale(true)
    if filtered is not None:
        scores["filter"] = _errors((filtered - true) / scale)
    if "observer" in errors:
        spread = load_fields(found / SPREAD).sel({"method": "observer"})
        bands = Z90 * np.stack([spread[name].values for name in fields], axis=1) / scale
        uncertain = bands > 0
        scores["observer"] = _errors(errors["observer"])
        scores["covered"] = float(np.mean((np.abs(errors["observer"]) <= bands)[uncertain]))
        seconds = json.loads((found / "run.json").read_text(encoding="utf-8"))["seconds"]
        scores["milliseconds"] = 1e3 * seconds[STEP]
    return scores


def _errors(error: Array) -> Errors:
    return Errors(whole=rmse(error), settled=rmse(error[len(error) // 2 :]))


def _told(row: Row) -> str:
    if row["problem"] is not None:
        return row["problem"]
    ratios = {name: ratio(row, name, "whole") for name in ("shred", "observer")}
    told = [f"{name} {'none' if r is None else f'{r:.2f}'}" for name, r in ratios.items()]
    return f"{row['verdict']}; errors over that of the filter: {', '.join(told)}"
