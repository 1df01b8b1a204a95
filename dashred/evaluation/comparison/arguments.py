"""The words of a comparison: those of a bench, and where the page goes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.config.bundled_systems import results_root
from dashred.core.command_line.argument_types import read_absolute_path
from dashred.core.command_line.arguments import Command, argument
from dashred.evaluation.benchmark import arguments as bench


@dataclass(frozen=True, kw_only=True)
class Request(bench.Request):
    """What one command asks for.

    Attributes:
        output: folder of the rows.
        document: file of the page; None for ``results.md`` in the folder of the rows.
    """

    output: Path = argument(
        read_absolute_path,
        "DIR",
        f"default: {results_root() / 'comparison'} (not tracked by git)",
        factory=lambda: results_root() / "comparison",
    )
    document: Path | None = argument(
        read_absolute_path,
        "FILE.md",
        "the page, its figures in figures/ beside it; default: DIR/results.md",
        default=None,
    )


COMMAND = Command(
    "dashred compare",
    Request,
    """\
Runs `dashred train` on every combination, as `dashred bench` does, and then, on the same
recordings, the simulation, optimal interpolation, SHRED on plain simulations, ensemble Kalman
filters of the state and with coefficients, and PDE-FIND given the full noisy field. Rows that are
done are not done again: after an interruption, give the same command again.""",
    rest="overrides of every run: see dashred train --help",
    after="""\
The page has every row that lies in DIR, those of earlier commands with the same overrides too, so
that systems with other seeds, or layouts, are other commands with the same output= and document=:

  dashred compare systems=rde,heat seeds=0-2 output=DIR document=docs/results.md
  dashred compare systems=ks2d seeds=0-1 output=DIR document=docs/results.md
  dashred compare systems=rde,ks2d sensors=4,8,20,49 noise=0.01,0.05,0.1 twins=a \\
      output=DIR document=docs/results.md

A row that failed, and a method of one, are on the page, too. The command then ends with 1; given
again it tries again, but where a simulator is not resolved.
""",
)


def read_words(argv: list[str]) -> Request:
    """Read the command line; ``--help`` prints the usage and exits with 0.

    Raises:
        InputError: an unknown word, or a value that cannot be read.
    """
    return bench.read_request(COMMAND, argv)
