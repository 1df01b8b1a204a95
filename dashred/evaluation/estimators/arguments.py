"""Arguments of the command ``dashred evaluate estimators``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.core.command_line.argument_types import (
    integer_reader,
    read_number,
)
from dashred.core.command_line.arguments import Command, argument
from dashred.evaluation.case_rows import (
    CaseRequest,
    output_argument,
    page_argument,
    read_action,
)

BENCHMARK = "estimators"


@dataclass(frozen=True, kw_only=True)
class Request(CaseRequest):
    """Settings of one command."""

    noise: float = argument(
        read_number, "0.05", "of the sensors, in std of what they read", default="0.01"
    )
    members: int = argument(
        integer_reader(at_least=10, at_most=100_000),
        "200",
        "members of the filter on the true law",
        default="1000",
    )
    output: Path = output_argument(BENCHMARK)
    document: Path = page_argument(BENCHMARK)


COMMAND = Command(
    f"dashred evaluate {BENCHMARK} run|document",
    Request,
    """\
Compares the estimators for real time that a run makes, the corrected SHRED and the observer, with
an ensemble filter that knows the true law. All read the same sensors, and no later reading. `run`
analyses the rows that are not done, and `document` writes the page of all rows.""",
    after="""\
DIR holds `rows/` with one file a row. After an interruption, give the same command again.
""",
)


def read_words(argv: list[str]) -> Request:
    """Read the command line; see :func:`.case_rows.read_action`."""
    return read_action(COMMAND, argv)
