"""Arguments of the proof command."""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

from dashred.config.bundled_systems import check_checkout, results_root
from dashred.core.cluster.word import EXAMPLES, HELP, Cluster, read_cluster
from dashred.core.command_line.argument_types import integer_reader, read_absolute_path
from dashred.core.command_line.arguments import COMMAND_LINE, Command, argument, key_value_pairs
from dashred.core.errors import InputError
from dashred.evaluation.isolation.worker import CHECKOUT
from dashred.evaluation.proof.cases.draw_file import read_draw
from dashred.evaluation.proof.request import Request

DRAW_KEYS = ("cases", "nulls", "jobs", "output", "draw")
MAX_COUNT = 100_000


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of the command."""

    cases: int = argument(
        integer_reader(at_most=MAX_COUNT),
        "120",
        "how many cases hide something (or, some of them, nothing)",
        default="12",
    )
    nulls: int = argument(
        integer_reader(at_most=MAX_COUNT),
        "100",
        "how many more hide nothing, a third of them with other troubles",
        default="0",
    )
    jobs: int = argument(
        integer_reader(at_least=1, at_most=MAX_COUNT),
        "2",
        "cases at once, each on one core",
        default="1",
    )
    cluster: Cluster | None = argument(read_cluster, EXAMPLES, HELP, default=None)
    output: Path | None = argument(
        read_absolute_path,
        "DIR",
        f"default: {results_root() / 'proof'}/COMMIT (not tracked by git)",
        default=None,
    )
    document: Path | None = argument(
        read_absolute_path,
        "FILE",
        "writes the result as Markdown, its figures beside it; default: DIR/proof.md",
        default=None,
    )
    pendulum: Path | None = argument(
        read_absolute_path,
        "FILE",
        "the recording of a real pendulum, for the document's appendix",
        default=None,
    )
    score: Path | None = argument(
        read_absolute_path,
        "DIR",
        "scores a finished draw again, with this commit's scorer: its analyses stay as they were "
        "frozen, and the document names both commits",
        default=None,
    )
    draw: str | None = argument(
        str,
        "TEXT",
        "draws other cases, for practice: the document says so. By default the hash of the commit "
        "under test gives the draw, so that nothing can have been tuned to it",
        default=None,
    )


COMMAND = Command(
    "dashred prove",
    Arguments,
    """\
Draws sealed cases, lets them be analysed by processes that have no way to the truth, freezes the
findings, opens the seals and scores. Cases that are done are not run again: after an interruption,
give the same command again.""",
    after="""\
DIR holds a folder a case, with its recording, its frozen findings, the seal that was opened after
that, and `case.json`; beside these, `draw.json` says what was drawn.
""",
)


def read_words(argv: list[str]) -> Request:
    """Read the command line; ``--help`` prints the usage and exits with 0.

    Raises:
        InputError: an unknown word, a value that cannot be read, or a checkout with changes.
    """
    words = COMMAND.read(argv)
    check_checkout("the proof is run")
    if words.pendulum is not None and not words.pendulum.is_file():
        raise InputError("this recording does not exist", where=str(words.pendulum))
    if words.score is not None:
        return _read_rescore(words, words.score, argv)
    draw = words.draw or commit_under_test()
    folder = re.sub(r"[^\w.-]", "_", draw)[:12]
    output = words.output or results_root() / "proof" / folder
    return Request(
        cases=words.cases,
        nulls=words.nulls,
        jobs=words.jobs,
        output=output,
        document=words.document or output / "proof.md",
        pendulum=words.pendulum,
        draw=draw,
        practice=words.draw is not None,
        cluster=words.cluster,
    )


def _read_rescore(words: Arguments, output: Path, argv: list[str]) -> Request:
    """Return the request that rescores an existing draw."""
    if excess := [key for key, _ in key_value_pairs(argv) if key in DRAW_KEYS]:
        hint = "the draw already determines it"
        raise InputError(
            f"score= cannot be combined with {excess[0]}=", where=COMMAND_LINE, hint=hint
        )
    return Request(
        **read_draw(output),
        output=output,
        document=words.document or output / "proof.md",
        pendulum=words.pendulum,
        scored_by=commit_under_test(),
    )


def commit_under_test() -> str:
    """Return the hash of the commit that is checked out.

    Raises:
        InputError: there is no commit, or files have changed since.
    """
    hint = "commit first, or practise with draw=TEXT"
    try:
        commit, changes = (
            subprocess.run(
                command, cwd=CHECKOUT, capture_output=True, text=True, check=True, timeout=10
            ).stdout.strip()
            for command in (["git", "rev-parse", "HEAD"], ["git", "status", "--porcelain", "-uno"])
        )
    except (OSError, subprocess.SubprocessError):
        raise InputError("this is not a git checkout", where=str(CHECKOUT), hint=hint) from None
    if changes:
        raise InputError(
            "files differ from the commit whose hash would seed the draw",
            where=str(CHECKOUT),
            hint=hint,
        )
    return commit
