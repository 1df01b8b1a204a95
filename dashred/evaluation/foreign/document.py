"""The page of all draws, ``docs/foreign.md``."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dashred.core.errors import InputError
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import canonical
from dashred.core.progress import CONSOLE
from dashred.core.templates import render
from dashred.evaluation.foreign.arguments import Request
from dashred.evaluation.foreign.cases.case import COLLECTIONS
from dashred.evaluation.foreign.draw_file import DRAW, Draw, read_draw
from dashred.evaluation.foreign.rows import Row, read_rows
from dashred.evaluation.foreign.tables import (
    detail_table,
    failure_table,
    outcome_table,
    overview,
    peer_problems,
    peer_tables,
    peer_versions,
    seconds_table,
)
from dashred.pipeline.run.output_dir import make_output

TEMPLATE = "evaluation/foreign/templates/foreign.md.j2"
Table = Callable[[Sequence[Row]], list[list[str]]]
TABLES: dict[str, Table] = {
    "outcomes": outcome_table,
    "details": detail_table,
    "peer_problems": peer_problems,
    "seconds": seconds_table,
    "failures": failure_table,
}


def write_document(request: Request) -> None:
    """Store the rows of a draw beside the page, and write the page of all stored draws.

    Raises:
        InputError: the folder has no draw, or that of another name.
    """
    facts = read_draw(request.output)
    if facts["draw"] != request.draw:
        raise InputError(
            f"these rows are of another draw, {facts['name']}",
            where=str(request.output / DRAW),
            hint="give the output=DIR of this draw",
        )
    folder = make_output(str(request.document.with_suffix("")))
    store_draw(folder / f"{request.folder}.jsonl", facts, read_rows(request.output))
    stored = [read_stored(path) for path in in_order(folder)]
    write_text_atomic(request.document, document(stored))
    CONSOLE.print(f"Document: {request.document}", markup=False, soft_wrap=True)


def in_order(folder: Path) -> list[Path]:
    """Return the files of all draws, the oldest first: foreign-9 comes before foreign-10."""
    return sorted(
        folder.glob("*.jsonl"),
        key=lambda path: [
            int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.stem)
        ],
    )


def document(draws: Sequence[tuple[Draw, list[Row]]]) -> str:
    """Return the page as Markdown, the newest draw first.

    Args:
        draws: the draws, the oldest first.
    """
    newest_first = draws[::-1]
    return render(
        TEMPLATE,
        collections=list(COLLECTIONS.values()),
        overview=[
            overview(facts["name"], sum(facts["cases"].values()), rows)
            for facts, rows in newest_first
        ],
        draws=[_section(facts, rows) for facts, rows in newest_first],
    )


def _section(facts: Draw, rows: list[Row]) -> dict[str, Any]:
    packages = ", ".join(f"{name} {version}" for name, version in facts["versions"].items())
    return {
        "facts": facts,
        "planned": sum(facts["cases"].values()),
        "finished": len(rows),
        "packages": packages,
        "peers": peer_tables(rows),
        "peer_packages": peer_versions(rows),
        **{name: table(rows) for name, table in TABLES.items()},
    }


def store_draw(path: Path, facts: Draw, rows: Sequence[Row]) -> None:
    """Write a draw as JSON lines: its facts, then its rows."""
    lines = [json.dumps(canonical(each), sort_keys=True, ensure_ascii=False) for each in rows]
    head = json.dumps(canonical(facts), sort_keys=True, ensure_ascii=False)
    write_text_atomic(path, "\n".join([head, *lines]) + "\n")


def read_stored(path: Path) -> tuple[Draw, list[Row]]:
    """Read a draw.

    Raises:
        InputError: the file is damaged.
    """
    try:
        facts, *rows = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    except ValueError:
        raise InputError(
            "this file does not hold the rows of a draw",
            where=str(path),
            hint="write it again: dashred evaluate foreign document",
        ) from None
    return facts, rows
