"""Arguments of the command ``dashred benchmark``."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from dashred.config.bundled_systems import check_checkout, read_bundled_name, results_root
from dashred.core.command_line.argument_types import (
    integer_reader,
    list_reader,
    read_absolute_path,
)
from dashred.core.command_line.arguments import COMMAND_LINE, Command, argument
from dashred.core.errors import InputError, nearest

PARTS = (
    *("grid", "sensors", "library", "record", "episodes", "members"),
    *("jobs", "cluster", "columns", "stages"),
)
# Whole analyses take minutes each, and are measured only where they are asked for.
DEFAULT_PARTS = PARTS[:-1]


def _read_part(text: str) -> str:
    if text not in PARTS:
        raise ValueError(f"there is no part {text!r}: {nearest(text, PARTS)}")
    return text


@dataclass(frozen=True, kw_only=True)
class Request:
    """Settings of one command.

    Attributes:
        parts: what is measured.
        grid: points of each of the two axes.
        sensors: numbers of sensors.
        library: numbers of terms.
        record: lengths of the record, as multiples of the shortest.
        episodes: numbers of episodes.
        members: numbers of trajectories of an ensemble.
        workers: numbers of workers of the parts jobs, cluster and columns.
        systems: systems of the part stages.
    """

    parts: tuple[str, ...] = argument(
        list_reader(_read_part),
        "grid,stages",
        f"what is measured, of {', '.join(PARTS)}",
        default=",".join(DEFAULT_PARTS),
    )
    grid: tuple[int, ...] = argument(
        list_reader(integer_reader(at_least=16, at_most=1024)),
        "32,64",
        "points of each of the two axes",
        default="32,48,64,96,128,192,256",
    )
    sensors: tuple[int, ...] = argument(
        list_reader(integer_reader(at_least=1, at_most=4096)),
        "8,16",
        "numbers of sensors",
        default="8,16,32,64,128,256",
    )
    library: tuple[int, ...] = argument(
        list_reader(integer_reader(at_least=4, at_most=200)),
        "10,20",
        "numbers of terms",
        default="10,20,50,100,200",
    )
    record: tuple[int, ...] = argument(
        list_reader(integer_reader(at_least=1, at_most=64)),
        "1,2",
        "lengths of the record, as multiples of the shortest",
        default="1,2,4,8",
    )
    episodes: tuple[int, ...] = argument(
        list_reader(integer_reader(at_least=1, at_most=256)),
        "1,2",
        "numbers of episodes",
        default="1,2,4,8,16,32,64",
    )
    members: tuple[int, ...] = argument(
        list_reader(integer_reader(at_least=1, at_most=4096)),
        "8,16",
        "numbers of trajectories of an ensemble",
        default="8,16,32,64,128,256",
    )
    workers: tuple[int, ...] = argument(
        list_reader(integer_reader(at_least=1, at_most=64)),
        "1,2",
        "numbers of workers of the parts jobs, cluster and columns",
        default="1,2,4,8",
    )
    systems: tuple[str, ...] = argument(
        list_reader(read_bundled_name),
        "pendulum,rde",
        "systems of the part stages, each a whole analysis of minutes",
        default="pendulum,rde,ks2d",
    )
    repeats: int = argument(
        integer_reader(at_least=1, at_most=100),
        "5",
        "how often each piece is timed; the shortest time counts",
        default="3",
    )
    output: Path = argument(
        read_absolute_path,
        "DIR",
        f"default: {results_root() / 'benchmark'} (not tracked by git)",
        factory=lambda: results_root() / "benchmark",
    )
    document: Path = argument(
        read_absolute_path,
        "FILE",
        "the page",
        default=str(results_root() / "docs/performance.md"),
    )


COMMAND = Command(
    "dashred benchmark",
    Request,
    """\
Measures on one core of this machine how the seconds and the memory of the parts of an analysis
grow, how far they are from the limit of the machine, and what more workers gain. Then it writes the
figures into the page, between two marks; the rest of the page stays as it is.""",
    after="""\
DIR holds one file a row. After an interruption, give the same command again: only the missing rows
are measured, and the page is written from all rows. Rows of another machine are measured again.
""",
)


def read_words(argv: list[str]) -> Request:
    """Read the command line; ``--help`` prints the usage and exits with 0.

    Raises:
        InputError: an unknown word, a value that cannot be read, or a part that needs a package
            that is not installed.
    """
    request = COMMAND.read(argv)
    check_checkout("the benchmark is run")
    divided = [part for part in ("cluster", "columns") if part in request.parts]
    if divided and find_spec("distributed") is None:
        raise InputError(
            f"the part {divided[0]} needs distributed, which is not installed",
            where=COMMAND_LINE,
            hint='pip install "dashred[cluster]", or leave the part out of parts=',
        )
    return request
