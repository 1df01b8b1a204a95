"""Write and read ``draw.json``: the draw of a folder of rows."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TypedDict

from dashred.core.errors import InputError
from dashred.evaluation.foreign.arguments import Request
from dashred.evaluation.foreign.cases.case import Case

DRAW = "draw.json"
SOLVERS = ("dysts", "py-pde", "scipy")


class Draw(TypedDict):
    """A draw.

    Attributes:
        name: the tag, or the text of a practice draw.
        draw: text from which the seed is derived.
        practice: whether the text is not the hash of the tagged commit.
        cases: number of cases by collection.
        limit: seconds after which an analysis is ended.
        peer_limit: the same of another method.
        versions: of the packages that compute the truths.
    """

    name: str
    draw: str
    practice: bool
    cases: dict[str, int]
    limit: int
    peer_limit: int
    versions: dict[str, str]


def describe_draw(request: Request, cases: Sequence[Case]) -> Draw:
    """Return the description of a complete draw."""
    counts: dict[str, int] = {}
    for case in cases:
        counts[case.collection] = counts.get(case.collection, 0) + 1
    return Draw(
        name=request.name,
        draw=request.draw,
        practice=request.practice,
        cases=counts,
        limit=request.limit,
        peer_limit=request.peer_limit,
        versions={package: _version(package) for package in SOLVERS},
    )


def read_draw(output: Path) -> Draw:
    """Read the draw of a folder.

    Raises:
        InputError: there is none.
    """
    path = output / DRAW
    try:
        facts: Draw = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(
            "there is no draw in this folder",
            where=str(path),
            hint="dashred evaluate foreign run writes one",
        ) from None
    return facts


def check_same_draw(output: Path, draw: Draw) -> None:
    """Check that a folder has no other draw: rows of two draws must not be mixed.

    Raises:
        InputError: it has.
    """
    if not (output / DRAW).is_file():
        return
    earlier = read_draw(output)
    if (earlier["draw"], earlier["cases"]) != (draw["draw"], draw["cases"]):
        raise InputError(
            f"this folder has another draw, {earlier['name']}, or one with other noise= or draws=",
            where=str(output / DRAW),
            hint="choose another folder: output=DIR",
        )


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
