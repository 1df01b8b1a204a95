"""Read rows of earlier commands from the output folder, for one document of all rows."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from dashred.core.command_line.arguments import key_value_pairs
from dashred.core.errors import InputError
from dashred.evaluation.benchmark.arguments import Request
from dashred.evaluation.benchmark.plan import Row, plan
from dashred.evaluation.benchmark.record import read_record
from dashred.evaluation.comparison.comparison_file import read_comparison

ROW_KEYS = ("twin", "noise", "seed", "sensors", "extra", "words")


def rows_of_document(request: Request, rows: Iterable[Row]) -> list[Row]:
    """Return the rows of this command and of earlier ones, sorted.

    Rows of earlier commands need the same overrides and the current system and truth.
    """
    by_folder = {row.folder: row for row in rows}
    for file in sorted(request.output.glob("*/*/row.json")):
        if file.parent not in by_folder and (row := _stored_row(file, request)) is not None:
            by_folder[row.folder] = row
    return sorted(by_folder.values(), key=_sort_key)


def _stored_row(file: Path, request: Request) -> Row | None:
    """Return the row of a folder; None if its plan has changed or it has not been compared.

    A row that an interrupted command has not compared is not a failure.
    """
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        [row] = plan(_request(record, request))
    except (OSError, ValueError, TypeError, KeyError, InputError):
        return None
    stored = read_record(row) if row.folder == file.parent else None
    if stored is None or not (stored["problem"] or read_comparison(row.folder)):
        return None
    return row


def _request(record: dict[str, Any], request: Request) -> Request:
    """Return a request for this row only.

    Raises:
        KeyError: the record is not that of a row.
    """
    twin, noise, seed, sensors, extra, words = (record[key] for key in ROW_KEYS)
    return replace(
        request,
        systems=(dict(key_value_pairs(words))["conf"],),
        twins=(twin,),
        seeds=(seed,),
        noise=(noise,),
        sensors=(sensors,),
        extra=(extra,),
    )


def _sort_key(row: Row) -> tuple[Any, ...]:
    places = [-1 if number is None else number for number in (row.sensors, row.extra)]
    return row.name, row.noise, *places, row.null, row.twin, row.seed, str(row.folder)
