"""The rows of the table: a twin, analysed with its equations and through a program."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TypedDict

from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.programs.arguments import Request

ROWS = "rows"


@dataclass(frozen=True)
class Case:
    """A twin of a bundled system, and its seed."""

    system: str
    twin: str
    seed: int

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"{self.system}-{self.twin}-{self.seed}"


class Answer(TypedDict):
    """The result of one analysis.

    Attributes:
        verdict: of the findings; null without findings.
        exact: whether the law has exactly the true terms; null if no law was sought.
        error: largest relative error of its coefficients; null if it is not exact.
        deviation: largest error of a coefficient in units of its stated std; null likewise.
        seconds: CPU seconds of the analysis.
        problem: why there are no findings.
    """

    verdict: str | None
    exact: bool | None
    error: float | None
    deviation: float | None
    seconds: float
    problem: str | None


class Row(TypedDict):
    """The result of a case.

    Attributes:
        system: name of the bundled system.
        twin: name of the hidden truth.
        seed: of the recording and of the analyses.
        budget: seconds on the clock that each analysis might take; null for the default.
        equations: the analysis with equations.
        program: the analysis through a function.
        calls: number of calls of the function.
        states: number of states that they stepped.
        seconds_inside: wall-clock seconds inside of the function.
    """

    system: str
    twin: str
    seed: int
    budget: int | None
    equations: Answer
    program: Answer
    calls: int
    states: int
    seconds_inside: float


def cases_of(request: Request) -> list[Case]:
    """Return the cases of a request."""
    return [Case(*each) for each in product(request.systems, request.twins, request.seeds)]


def write_row(output: Path, case: Case, row: Row) -> None:
    """Write a row completely or not at all."""
    write_json_atomic(_path(output, case), row)


def is_done(output: Path, case: Case) -> bool:
    """Return whether a case has a row."""
    return _path(output, case).is_file()


def read_rows(output: Path) -> list[Row]:
    """Return all rows of a folder, by name and seed."""
    paths = (output / ROWS).glob("*.json")
    rows: list[Row] = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    return sorted(rows, key=lambda row: (row["system"], row["twin"], row["seed"]))


def _path(output: Path, case: Case) -> Path:
    return output / ROWS / f"{case.name}.json"
