"""What a draw is made of, kept beside its cases so that they can be scored again: ``draw.json``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypedDict

from dashred.core.errors import InputError
from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.proof.request import Request

DOCUMENT = "draw.json"


class Draw(TypedDict):
    """A draw.

    Attributes:
        draw: what its seed is made of: of the proof the hash of the commit that analyses it.
        practice: whether it is another text.
        cases: how many hide something.
        nulls: how many more do not.
        jobs: that were analysed at once.
    """

    draw: str
    practice: bool
    cases: int
    nulls: int
    jobs: int


def keep_draw(request: Request) -> None:
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
        InputError: there is none, or it cannot be read.
    """
    path = output / DOCUMENT
    hint = "name the folder of a draw: output=DIR of the command that made it"
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        kinds = {"draw": str, "practice": bool, "cases": int, "nulls": int, "jobs": int}
        sound = all(type(known[key]) is kind for key, kind in kinds.items())
    except OSError:
        raise InputError("there is no draw here", where=str(path), hint=hint) from None
    except (ValueError, TypeError, KeyError):
        sound = False
    if not sound or min(known["cases"], known["nulls"], known["jobs"] - 1) < 0:
        raise InputError("this is no record of a draw", where=str(path), hint=hint)
    return Draw(
        draw=known["draw"],
        practice=known["practice"],
        cases=known["cases"],
        nulls=known["nulls"],
        jobs=known["jobs"],
    )
