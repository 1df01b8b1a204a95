"""Arguments of the command ``dashred evaluate programs``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.config.bundled_systems import results_root
from dashred.core.command_line.argument_types import read_absolute_path
from dashred.core.command_line.arguments import Command, argument
from dashred.evaluation.case_rows import CaseRequest, read_action

BENCHMARK = "programs"


@dataclass(frozen=True, kw_only=True)
class Request(CaseRequest):
    """Settings of one command."""

    output: Path = argument(
        read_absolute_path,
        "DIR",
        f"default: {results_root() / BENCHMARK} (not tracked by git)",
        factory=lambda: results_root() / BENCHMARK,
    )
    document: Path = argument(
        read_absolute_path, "FILE", "the page", default=str(results_root() / "docs/programs.md")
    )


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
