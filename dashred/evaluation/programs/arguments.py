"""Arguments of the command ``dashred evaluate programs``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.core.command_line.arguments import Command
from dashred.evaluation.case_rows import (
    CaseRequest,
    output_argument,
    page_argument,
    read_action,
)

BENCHMARK = "programs"


@dataclass(frozen=True, kw_only=True)
class Request(CaseRequest):
    """Settings of one command."""

    output: Path = output_argument(BENCHMARK)
    document: Path = page_argument(BENCHMARK)


COMMAND = Command(
    f"dashred evaluate {BENCHMARK} run|document",
    Request,
    """\
Analyses twins of the bundled systems at 1 % noise twice: with their equations, and with the
equations hidden behind a function in Python. `run` analyses the rows that are not done, and
`document` writes the page of all rows.""",
    after="""\
DIR holds `rows/` with one file a row, `analyses/` with the recordings and findings, and `truths/`
with what was hidden, written after the findings are frozen. After an interruption, give the same
command again.
""",
)


def read_words(argv: list[str]) -> Request:
    """Read the command line; see :func:`.case_rows.read_action`."""
    return read_action(COMMAND, argv)
