"""Arguments of the command ``dashred evaluate programs``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from dashred.config.bundled_systems import (
    bundled_names,
    check_checkout,
    read_bundled_name,
    results_root,
)
from dashred.core.command_line.argument_types import (
    integer_reader,
    list_reader,
    ranges_reader,
    read_absolute_path,
)
from dashred.core.command_line.arguments import COMMAND_LINE, HELP_FLAGS, Command, argument
from dashred.core.errors import InputError, nearest

BENCHMARK = "programs"
ACTIONS = ("run", "document")


@dataclass(frozen=True, kw_only=True)
class Request:
    """Settings of one command.

    Attributes:
        action: run or document.
    """

    systems: tuple[str, ...] = argument(
        list_reader(read_bundled_name),
        "wave,rde",
        "bundled systems",
        default=",".join(bundled_names()),
    )
    twins: tuple[str, ...] = argument(
        list_reader(str), "a,b", "hidden truths of each system", default="a"
    )
    seeds: tuple[int, ...] = argument(
        ranges_reader(at_most=10_000), "0-4", "a range, or a list such as 0,1,3", default="0"
    )
    limit: int = argument(
        integer_reader(at_least=1, at_most=100_000),
        "1200",
        "seconds after which an analysis is ended: no answer",
        default="1200",
    )
    budget: int | None = argument(
        integer_reader(at_least=1, at_most=100_000),
        "1800",
        "seconds on the clock that each analysis may take; default: as for any analysis",
        default=None,
    )
    output: Path = argument(
        read_absolute_path,
        "DIR",
        f"default: {results_root() / BENCHMARK} (not tracked by git)",
        factory=lambda: results_root() / BENCHMARK,
    )
    document: Path = argument(
        read_absolute_path, "FILE", "the page", default=str(results_root() / "docs/programs.md")
    )
    action: str = ""


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
    """Read the command line; ``--help`` prints the usage and exits with 0.

    Raises:
        InputError: an unknown word, or a value that cannot be read.
    """
    if HELP_FLAGS & set(argv):
        COMMAND.read(["--help"])
    action, *rest = argv[1:] or [""]
    if action not in ACTIONS:
        fault = f"there is no action {action!r}" if action else "which action?"
        raise InputError(fault, where=COMMAND_LINE, hint=nearest(action, ACTIONS))
    words = COMMAND.read(rest)
    check_checkout("the evaluation is run")
    return replace(words, action=action)
