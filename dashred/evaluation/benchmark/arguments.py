"""The words of a bench's command line: what to run, how, and where to."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeVar

from dashred.config import Settings, bundled_names
from dashred.config.bundled_systems import results_root
from dashred.core.cluster.word import EXAMPLES, HELP, Cluster, read_cluster
from dashred.core.command_line.argument_types import (
    integer_reader,
    list_reader,
    ranges_reader,
    read_absolute_path,
    read_number,
)
from dashred.core.command_line.arguments import COMMAND_LINE, HELP_FLAGS, Command, argument
from dashred.core.errors import InputError

# What differs from row to row, or is settled by the bench, and the word that says it here.
RESERVED = {
    "conf": "systems=",
    "seed": "seeds=",
    "twin": "twins=",
    "recording.twin": "twins=",
    "recording.noise": "noise=",
    "recording.sensors": "sensors=",
    "splits.sensors.extra": "extra=",
    "recording.path": "dashred train: a recording of your own has no truth to bench by",
    "tracking.run": "nothing: every row opens a run of its own",
    "tracking.parent": "nothing: the bench opens the run that the rows are nested below",
}
# Keys of a configuration that are words of the bench itself.
OWN_WORDS = ("output", "cluster")
# Instead of a number of sensors: the system's own.
SYSTEM_NUMBER = "own"


def _read_systems(text: str) -> tuple[str, ...]:
    return tuple(bundled_names()) if text == "all" else list_reader(str)(text)


def _read_count(text: str) -> int | None:
    return None if text == SYSTEM_NUMBER else integer_reader(at_most=9999)(text)


@dataclass(frozen=True, kw_only=True)
class Request:
    """What one command asks for.

    Attributes:
        systems: bundled names or paths.
        twins: null takes the basic ones of each system.
        sensors: numbers of fit sensors; None for the system's own.
        extra: of them, how many SHRED's input is without; None for the system's own.
        overrides: words for every run.
    """

    systems: tuple[str, ...] = argument(
        _read_systems,
        "SYSTEM,...",
        f"bundled systems ({', '.join(bundled_names())}), all (every one), or paths of YAML files",
    )
    twins: tuple[str, ...] | None = argument(
        list_reader(str),
        "a,b,null",
        "hidden truths; default: those that start from the simulator's own start",
        default=None,
    )
    seeds: tuple[int, ...] = argument(
        ranges_reader(at_most=10_000), "0-4", "a range, or a list such as 0,1,3", default="0"
    )
    noise: tuple[float, ...] = argument(
        list_reader(read_number),
        "0.01,0.05",
        "fractions of each field's standard deviation",
        default="0.05",
    )
    sensors: tuple[int | None, ...] = argument(
        list_reader(_read_count),
        "own,4,8",
        "numbers of fit sensors; own is the system's own number",
        default=SYSTEM_NUMBER,
    )
    extra: tuple[int | None, ...] = argument(
        list_reader(_read_count),
        "own,0,4",
        "of them, those that SHRED's input is without",
        default=SYSTEM_NUMBER,
    )
    jobs: int = argument(
        integer_reader(at_least=1, at_most=9999),
        "2",
        "rows at once; more than one disturb each other's seconds",
        default="1",
    )
    cluster: Cluster | None = argument(read_cluster, EXAMPLES, HELP, default=None)
    output: Path = argument(
        read_absolute_path,
        "DIR",
        f"default: {results_root() / 'bench'} (not tracked by git)",
        factory=lambda: results_root() / "bench",
    )
    overrides: tuple[str, ...] = ()


COMMAND = Command(
    "dashred bench",
    Request,
    """\
Runs `dashred train` on every combination, each in a process of its own, and ends in a table. Rows
that are done are not run again: after an interruption, give the same command again.""",
    rest="overrides of every run: simulation.members=96 threads=2; see dashred train --help",
    after="""\
DIR holds a folder a row with its findings, `row.json` and `log.txt`, and above them `table.md` and
`table.json`: the rows of this command, and a summary for each system and noise. A row that failed
is tried again the next time. In MLflow the rows are nested below one run of the experiment
`bench` (tracking.experiment=NAME for another).
""",
)
R = TypeVar("R", bound=Request)


def read_words(argv: list[str]) -> Request:
    """Read the command line; ``--help`` prints the usage and exits with 0.

    Raises:
        InputError: an unknown word, or a value that cannot be read.
    """
    return read_request(COMMAND, argv)


def read_request(command: Command[R], argv: list[str]) -> R:
    """Read a command's own words, and keep the others for every run.

    Raises:
        InputError: an unknown word, or a value that cannot be read.
    """
    sections = [field.name for field in fields(Settings)]
    own: list[str] = []
    overrides: list[str] = []
    for text in argv:
        key, sign, _ = text.partition("=")
        if key in RESERVED and not HELP_FLAGS & set(argv):
            what, hint = f"{key}= is not a word of {command.program}", f"use {RESERVED[key]}"
            raise InputError(what, where=COMMAND_LINE, hint=hint)
        passed_on = sign and key.partition(".")[0] in sections and key not in OWN_WORDS
        (overrides if passed_on else own).append(text)
    return replace(command.read(own, others=sections), overrides=tuple(overrides))
