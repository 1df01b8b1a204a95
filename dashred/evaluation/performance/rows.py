"""The rows: one file for each, written completely or not at all."""

from __future__ import annotations

import json
import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dashred.core.findings.findings import canonical, write_json_atomic
from dashred.evaluation.performance.plan import Task

# A row as stored: part, size, repeats, machine, time, git_commit, and what was measured.
Row = dict[str, Any]

PACKAGES = ("numpy", "scipy", "torch", "numba")


def machine() -> dict[str, str]:
    """Return what tells this machine from another one."""
    versions = {name: version(name) for name in PACKAGES}
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
        **versions,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def key_of(task: Task) -> Row:
    """Return what decides whether a stored row is that of a task."""
    key = {"part": task.part, "size": task.size, "repeats": task.repeats, "machine": machine()}
    return dict(canonical(key))


def write_row(output: Path, task: Task, row: Row) -> None:
    """Store a row."""
    write_json_atomic(_path(output, task), key_of(task) | row)


def is_done(output: Path, task: Task) -> bool:
    """Return whether a row was measured, on this machine."""
    stored, key = _read(_path(output, task)), key_of(task)
    return stored is not None and all(stored.get(name) == value for name, value in key.items())


def read_rows(output: Path) -> list[Row]:
    """Return the rows of this machine, by part and size."""
    found = [_read(path) for path in sorted((output / "rows").glob("*.json"))]
    here = canonical(machine())
    rows = [row for row in found if row is not None and row.get("machine") == here]
    return sorted(rows, key=lambda row: (row["part"], isinstance(row["size"], str), row["size"]))


def _read(path: Path) -> Row | None:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def _path(output: Path, task: Task) -> Path:
    return output / "rows" / f"{task.name}.json"
