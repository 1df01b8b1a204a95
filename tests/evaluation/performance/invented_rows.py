"""Rows of a benchmark that nobody has measured, with seconds that follow a known law."""

from __future__ import annotations

from pathlib import Path

from dashred.core.findings.findings import canonical
from dashred.evaluation.performance.plan import GROWTHS, Task
from dashred.evaluation.performance.rows import Row, machine, write_row

POWERS = {"march": 1.0, "columns": 1.25, "normal equations": 0.0, "selection": 3.0}
RATES = {"transform64": 50e-6, "transform32": 25e-6, "bandwidth": 2e10, "arithmetic": 4e10}


def growth_row(part: str, size: int) -> Row:
    """Return a row whose seconds grow with given powers, and its memory by 2 MiB for each unit."""
    growth = GROWTHS[part]
    amount = growth.amount(size)
    pieces = {
        name: {
            "seconds": 1e-3 * amount ** POWERS[name],
            "work": {"trajectory steps": 80, "column steps": 320},
        }
        for name in growth.pieces
    }
    row = common(part, size) | {"amount": amount, "pieces": pieces, "memory": 400.0 + 2.0 * amount}
    if part == "grid":
        need = {"seconds": 1e-3, "operations": 2e6, "bytes": 3e6, "transforms": 16}
        row["floor"] = {"rates": RATES, "scheme": {}, "march": need, "columns": need}
    return row


def common(part: str, size: int | str) -> Row:
    """Return what every row has."""
    found = {"part": part, "size": size, "repeats": 3, "machine": machine()}
    return dict(canonical(found)) | {"git_commit": "0123abc", "date": "2026-11-28"}


def stored(output: Path, *rows: Row) -> None:
    """Store rows in a folder."""
    (output / "rows").mkdir(parents=True, exist_ok=True)
    for row in rows:
        write_row(output, Task(row["part"], row["size"], row["repeats"]), row)
