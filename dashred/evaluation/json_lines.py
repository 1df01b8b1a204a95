"""Rows of a page as JSON lines, in a file beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import canonical
from dashred.core.progress import CONSOLE


def write_page(page: Path, text: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a page and its rows beside it, and say where."""
    write_rows_beside(page, rows)
    write_text_atomic(page, text)
    CONSOLE.print(f"Document: {page}", markup=False, soft_wrap=True)


def write_rows_beside(page: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the rows of ``page`` to a file of its name that ends with ``.jsonl``."""
    lines = [json.dumps(canonical(row), sort_keys=True) for row in rows]
    write_text_atomic(page.with_suffix(".jsonl"), "\n".join(lines) + "\n")
