"""Arguments of the command ``dashred evaluate networks``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.core.command_line.argument_types import read_number
from dashred.core.command_line.arguments import Command, argument
from dashred.evaluation.case_rows import (
    CaseRequest,
    output_argument,
    page_argument,
    read_action,
)

BENCHMARK = "networks"


@dataclass(frozen=True, kw_only=True)
class Request(CaseRequest):
    """Settings of one command."""

    noise: float = argument(
        read_number, "0.05", "of the sensors, in std of what they read", default="0.01"
    )
    output: Path = output_argument(BENCHMARK)
    document: Path = page_argument(BENCHMARK)


COMMAND = Command(
    f"dashred evaluate {BENCHMARK} run|document",
    Request,
    """\
Compares the assimilation with dynamics with SHRED and with the assimilation by sensors alone, and
with each part of it switched off. The fit through the simulator is not run. `run` fits the rows
that are not done, and `document` writes the page of all rows.""",
    after="""\
DIR holds `rows/` with one file a row. After an interruption, give the same command again. The word
budget= has no effect: a fit ends where its own criteria say so, or after limit= seconds.
""",
)


def read_words(argv: list[str]) -> Request:
    """Read the command line; see :func:`.case_rows.read_action`."""
    return read_action(COMMAND, argv)
