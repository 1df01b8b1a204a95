"""Write and read ``draw.json``, the settings of a draw, so that it can be rescored."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypedDict

from dashred.core.errors import InputError
from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.proof.request import Request

DOCUMENT = "draw.json"


class Draw(TypedDict):
    """Settings of a draw.

    Attributes:
        draw: text from which the seed is derived: the hash of the commit under test.
        practice: whether the text is not the hash of the commit.
        cases: number of cases.
        nulls: number of nulls.
        jobs: number of parallel analyses.
    """

    draw: str
    practice: bool
    cases: int
    nulls: int
    jobs: int


def write_draw(request: Request) -> None:
    """Write ``draw.json`` into the folder of the cases."""
    draw = Draw(
        draw=request.draw,
        practice=request.practice,
        cases=request.cases,
        nulls=request.nulls,
        jobs=request.jobs,
    )
    write_json_atomic(request.output / DOCUMENT, draw)


def read_draw(output: Path) -> Draw:
    """Read ``draw.json``.

    Raises:
        InputError: the file does not exist or cannot be read.
    """
    path = output / DOCUMENT
    hint = "give the folder of a draw: the output=DIR of its command"
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        kinds = {"draw": str, "practice": bool, "cases": int, "nulls": int, "jobs": int}
        is_valid = all(type(known[key]) is kind for key, kind in kinds.items())
    except OSError:
        raise InputError("there is no draw in this folder", where=str(path), hint=hint) from None
    except (ValueError, TypeError, KeyError):
        is_valid = False
    if not is_valid or min(known["cases"], known["nulls"], known["jobs"] - 1) < 0:
        raise InputError("this file does not describe a draw", where=str(path), hint=hint)
    return Draw(
        draw=known["draw"],
        practice=known["practice"],
        cases=known["cases"],
        nulls=known["nulls"],
        jobs=known["jobs"],
    )
