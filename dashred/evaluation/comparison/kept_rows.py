"""Rows that other commands have left in a folder: one page holds them all."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from dashred.core.arguments import pairs
from dashred.core.errors import InputError
from dashred.evaluation.benchmark.arguments import Request
from dashred.evaluation.benchmark.plan import Row, plan
from dashred.evaluation.benchmark.record import read_kept
from dashred.evaluation.comparison.kept_comparison import read_compared

OF_A_ROW = ("twin", "noise", "seed", "sensors", "extra", "words")


def rows_of_page(request: Request, rows: Iterable[Row]) -> list[Row]:
    """Return the rows of this command and those that others have left, in an order of their own.

    Of the others those with the same overrides, whose system and truth are today's.
    """
    found = {row.folder: row for row in rows}
    for file in sorted(request.output.glob("*/*/row.json")):
        if file.parent not in found and (row := _kept(file, request)) is not None:
            found[row.folder] = row
    return sorted(found.values(), key=_place)


def _kept(file: Path, request: Request) -> Row | None:
    """Return the row that a folder holds; None where it would be another today, or has not ended.

    What a command that was cut short has not compared is no failure.
    """
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        [row] = plan(_request(record, request))
    except (OSError, ValueError, TypeError, KeyError, InputError):
        return None
    kept = read_kept(row) if row.folder == file.parent else None
    if kept is None or not (kept["problem"] or read_compared(row.folder)):
        return None
    return row


def _request(record: dict[str, Any], request: Request) -> Request:
    """Return what asks for this row alone.

    Raises:
        KeyError: it is no record of a row.
    """
    twin, noise, seed, sensors, extra, words = (record[key] for key in OF_A_ROW)
    return replace(
        request,
        systems=(dict(pairs(words))["conf"],),
        twins=(twin,),
        seeds=(seed,),
        noise=(noise,),
        sensors=(sensors,),
        extra=(extra,),
    )


def _place(row: Row) -> tuple[Any, ...]:
    places = [-1 if number is None else number for number in (row.sensors, row.extra)]
    return row.name, row.noise, *places, row.null, row.twin, row.seed, str(row.folder)
