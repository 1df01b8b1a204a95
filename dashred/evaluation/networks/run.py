"""Run the rows: record a twin, fit the networks to it, and score them."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from dashred.core.errors import DONE
from dashred.core.findings.findings import sha256_of
from dashred.core.job_control import last_line
from dashred.evaluation.baselines.assimilations import FIELDS, LAWS, VARIANTS
from dashred.evaluation.case_rows import Case, run_cases
from dashred.evaluation.concealed_twin import RECORDING, SEALED, record_concealed
from dashred.evaluation.networks.arguments import BENCHMARK, Request
from dashred.evaluation.networks.rows import DYNAMICS, SHRED, LawScore, Row, ratio
from dashred.evaluation.twins.score_command import load_fields, true_states
from dashred.evaluation.twins.scoring import law_of_findings, law_of_truth, rmse, scaled_errors
from dashred.evaluation.twins.sealing import Truth, open_seal

LOG = "log.txt"


def run_networks(request: Request) -> None:
    """Run the rows of a request that are not done."""
    run_cases(request, request.output, BENCHMARK, partial(_run_case, request), _told)


def _run_case(request: Request, case: Case) -> Row:
    """Return the row of a case. The networks are fitted in a process of their own."""
    row = Row(
        system=case.system,
        twin=case.twin,
        seed=case.seed,
        noise=request.noise,
        problem=None,
        rmse={},
        laws={},
        seconds={},
    )
    with tempfile.TemporaryDirectory(prefix="dashred-networks-") as name:
        folder, found = Path(name) / "case", Path(name) / "found"
        # While the networks are fitted, the truth is in the memory of this process alone.
        sealed = record_concealed(case, request.noise, folder)
        problem = _fit(request, case, folder / RECORDING, found)
        if problem is not None:
            row["problem"] = problem
            return row
        fitted = json.loads((found / LAWS).read_text(encoding="utf-8"))
        if sha256_of(found / FIELDS) != fitted["fields_sha256"]:
            raise RuntimeError(f"{FIELDS} has changed since it was frozen")
        (folder / SEALED).write_bytes(sealed)
        truth, fields = open_seal(folder / SEALED)
        estimates = load_fields(found / FIELDS)
        true = true_states(estimates, truth, fields, folder / SEALED)
    row["rmse"] = {m: rmse(error) for m, error in scaled_errors(estimates, true, fields).items()}
    row["laws"], row["seconds"] = _laws(fitted, truth), fitted["seconds"]
    return row


def _fit(request: Request, case: Case, recording: Path, found: Path) -> str | None:
    """Fit the networks of a case; return why there is no result, or None."""
    module = "dashred.evaluation.baselines.assimilations"
    words = [f"conf={case.system}", f"seed={case.seed}", "threads=1"]
    words += [f"recording.path={recording}", f"output={found}"]
    log = recording.with_name(LOG)
    with log.open("w", encoding="utf-8") as stream:
        try:
            code = subprocess.run(
                [sys.executable, "-m", module, *words],
                stdout=stream,
                stderr=subprocess.STDOUT,
                timeout=request.limit,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            return f"no answer within {request.limit} s"
    return None if code == DONE else last_line(log) or f"exit code {code}"


def _laws(fitted: Mapping[str, Any], truth: Truth) -> dict[str, LawScore]:
    """Return the scores of the laws: two by sensors alone, and one by variant with dynamics."""
    laws: dict[str, Any] = {}
    for name, proposed in fitted["laws"].items():
        variant = VARIANTS[name]
        laws |= {name: proposed[variant.law]} if variant.dynamics else proposed
    findings = {"input": fitted["input"], "terms": []}
    true = law_of_truth(findings, truth.terms, truth.concealed.parameters)
    scores = {}
    for name, terms in laws.items():
        law = law_of_findings({**findings, "terms": terms})
        both = law.keys() & true.keys()
        scores[name] = LawScore(
            found=len(both),
            spurious=len(law.keys() - both),
            missed=len(true.keys() - both),
            error=max((abs(law[key] / true[key] - 1) for key in both), default=None),
        )
    return scores


def _told(row: Row) -> str:
    if row["problem"] is not None:
        return row["problem"]
    law = row["laws"][DYNAMICS]
    return (
        f"error with dynamics {row['rmse'][DYNAMICS]:.2g}, {ratio(row, DYNAMICS, SHRED):.2g} of "
        f"SHRED's; {law['found']} true terms, {law['missed']} missed, {law['spurious']} others"
    )
