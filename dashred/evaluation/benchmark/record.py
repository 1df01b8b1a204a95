"""Record of a row, gathered from the files of its run and stored in ``row.json``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from dashred.core.errors import DONE
from dashred.core.findings.findings import canonical, write_json_atomic
from dashred.core.job_control import last_line
from dashred.evaluation.benchmark.plan import Row
from dashred.evaluation.benchmark.processes import LOG

FLAGGED = {
    "ambiguous",
    "not-converged",
    "outside-library",
    "unconfirmed",
    "unresolved-numerics",
}
RATIOS = {
    "corrected/simulation_same_start": ("corrected", "simulation_same_start"),
    "corrected/simulation_refit": ("corrected", "simulation_refit"),
    "corrected_shred/dashred": ("corrected_shred", "dashred"),
}
TERM = ("equation", "term", "coefficient", "std", "parameter", "from", "to", "region")

Record = dict[str, Any]


def read_finished(row: Row) -> Record | None:
    """Return the record of a successful row with the same key; None if it must be run."""
    record = read_record(row)
    return record if record is not None and record["problem"] is None else None


def read_record(row: Row) -> Record | None:
    """Return the record of a finished or failed row with the same key; None if there is none."""
    try:
        record = json.loads((row.folder / "row.json").read_text(encoding="utf-8"))
        same = record["key"] == canonical(row.key) and "problem" in record
    except (OSError, ValueError, TypeError, KeyError):
        return None
    # The facts of the plan override stored ones, which an earlier version may have written.
    return record | canonical(_plan_facts(row)) if same else None


def write_record(row: Row, code: int, seconds: float) -> Record:
    """Gather the record of a row and store it."""
    record: Record = {
        **_plan_facts(row),
        "exit_code": code,
        "wall_seconds": round(seconds, 2),
        "problem": None if code == DONE else last_line(row.folder / LOG) or f"exit code {code}",
    }
    if code == DONE:
        try:
            record |= _results(row.folder)
        except (OSError, ValueError, KeyError) as error:
            record["problem"] = f"the run has no results: {error}"
    write_json_atomic(row.folder / "row.json", record)
    return dict(canonical(record))


def _plan_facts(row: Row) -> Record:
    """Return the facts of a row that are known before it runs."""
    return {
        "key": row.key,
        "system": row.name,
        "twin": row.twin,
        "noise": row.noise,
        "seed": row.seed,
        "sensors": row.sensors,
        "extra": row.extra,
        "null": row.null,
        "law": row.law,
        "words": list(row.words),
    }


def _results(folder: Path) -> Record:
    findings, score, run = (
        json.loads((folder / name).read_text(encoding="utf-8"))
        for name in ("findings.json", "score.json", "run.json")
    )
    found = findings["terms"]
    rmse = score["field_rmse"]
    return {
        "verdict": findings["verdict"],
        "flagged": findings["verdict"] in FLAGGED,
        "terms": None if found is None else [{k: t.get(k) for k in TERM} for t in found],
        "exact_support": score["exact_support"],
        "cause_right": score.get("cause_right"),
        "coefficient_error": score["coefficient_error"],
        "field_rmse": rmse,
        "field_rmse_by_field": score["field_rmse_by_field"],
        "forecast": score["forecast"],
        "ratios": {name: ratio_of(rmse.get(a), rmse.get(b)) for name, (a, b) in RATIOS.items()},
        "seconds": run["seconds"],
        "git_commit": run["git_commit"],
        "mlflow_run": run["mlflow_run"],
    }


def ratio_of(value: float | None, reference: float | None) -> float | None:
    """Return a ratio; None if a value is unknown or the reference is 0."""
    return value / reference if value is not None and reference else None
