"""Arguments of the command ``dashred evaluate foreign``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from dashred.config.bundled_systems import check_checkout, results_root
from dashred.core.cluster.word import EXAMPLES, HELP, Cluster, read_cluster
from dashred.core.command_line.argument_types import (
    integer_reader,
    list_reader,
    read_absolute_path,
    read_number,
)
from dashred.core.command_line.arguments import COMMAND_LINE, HELP_FLAGS, Command, argument
from dashred.core.errors import InputError, nearest
from dashred.evaluation.foreign.cases.case import COLLECTIONS
from dashred.evaluation.foreign.protocol import commit_of_tag
from dashred.evaluation.proof.arguments import commit_under_test

BENCHMARK = "foreign"
ACTIONS = ("plan", "run", "document")
LARGEST_NOISE = 0.5
MAX_COUNT = 100_000


def _read_collection(text: str) -> str:
    if text not in COLLECTIONS:
        raise ValueError(f"there is no collection {text!r}: {nearest(text, COLLECTIONS)}")
    return text


def _read_noise(text: str) -> float:
    if not 0 < (share := read_number(text)) <= LARGEST_NOISE:
        raise ValueError(f"{text} is not a share above 0 and at most {LARGEST_NOISE:g}")
    return share


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of the command."""

    tag: str | None = argument(
        str,
        "NAME",
        "git tag of the commit under test: its hash gives the draw, and `run` needs it checked out",
        default=None,
    )
    draw: str | None = argument(
        str,
        "TEXT",
        "draws other cases, for practice, instead of tag=: the page says so",
        default=None,
    )
    noise: tuple[float, ...] = argument(
        list_reader(_read_noise),
        "0.02,0.05",
        "std of the noise as a share of that of a reading; fields and mechanics have the first, "
        "problems of other papers their own",
        default="0.02",
    )
    draws: int = argument(
        integer_reader(at_least=1, at_most=1000),
        "3",
        "draws of each polynomial system at each noise, and of the published Lorenz system",
        default="3",
    )
    collections: tuple[str, ...] = argument(
        list_reader(_read_collection),
        "dysts,fields",
        "runs these now; the draw and the page have all",
        default=",".join(COLLECTIONS),
    )
    cases: tuple[str, ...] | None = argument(
        list_reader(str),
        "NAME,...",
        "runs these now, by the names that `plan` prints",
        default=None,
    )
    jobs: int = argument(
        integer_reader(at_least=1, at_most=MAX_COUNT),
        "2",
        "cases at once, each on one core",
        default="1",
    )
    cluster: Cluster | None = argument(read_cluster, EXAMPLES, HELP, default=None)
    limit: int = argument(
        integer_reader(at_least=1, at_most=MAX_COUNT),
        "900",
        "seconds after which an analysis is ended: no answer",
        default="900",
    )
    peer_limit: int = argument(
        integer_reader(at_most=MAX_COUNT),
        "120",
        "seconds for each other method; 0 runs none",
        default="120",
    )
    output: Path | None = argument(
        read_absolute_path,
        "DIR",
        f"default: {results_root() / BENCHMARK}/TAG (not tracked by git)",
        default=None,
    )
    document: Path = argument(
        read_absolute_path,
        "FILE",
        "the page; the rows of its draws are in the folder of the same name beside it",
        default=str(results_root() / "docs" / "foreign.md"),
    )


@dataclass(frozen=True, kw_only=True)
class Request:
    """Settings of one command; see :class:`Arguments`.

    Attributes:
        action: plan, run or document.
        name: the tag, or the text of a practice draw.
        draw: text that gives the seed.
        practice: whether the text is not the hash of a tagged commit.
    """

    action: str
    name: str
    draw: str
    practice: bool
    noise: tuple[float, ...]
    draws: int
    collections: tuple[str, ...]
    cases: tuple[str, ...] | None
    jobs: int
    cluster: Cluster | None
    limit: int
    peer_limit: int
    output: Path
    document: Path

    @property
    def folder(self) -> str:
        """The name as the name of a folder or file."""
        return folder_name(self.name)


COMMAND = Command(
    f"dashred evaluate {BENCHMARK} plan|run|document",
    Arguments,
    """\
Analyses recordings of systems whose truths other solvers have computed: the polynomial systems of
dysts, fields by py-pde, mechanics by SciPy. `plan` lists the cases, `run` analyses those that are
not done, and `document` writes the page of all draws. The cases need pip install
"dashred[evaluation]".""",
    after="""\
DIR holds `rows/` with one file a case, written when the case is scored, `analyses/` with the
findings, and `truths/` with what was hidden, written after the findings are frozen. After an
interruption, give the same command again.
""",
)


def read_words(argv: list[str]) -> Request:
    """Read the command line; ``--help`` prints the usage and exits with 0.

    Raises:
        InputError: an unknown word, a value that cannot be read, a tag that does not exist, or a
            checkout that is not at the tag.
    """
    if HELP_FLAGS & set(argv):
        COMMAND.read(["--help"])
    benchmark, action, *rest = [*argv, "", ""][: max(2, len(argv))]
    _check_choice("benchmark", benchmark, (BENCHMARK, "programs", "estimators", "networks"))
    _check_choice("action", action, ACTIONS)
    words = COMMAND.read(rest)
    check_checkout("the evaluation is run")
    if (words.tag is None) == (words.draw is None):
        what = "one of tag=NAME and draw=TEXT is needed"
        raise InputError(what, where=COMMAND_LINE, hint="tag=NAME for the draw that counts")
    draw = words.draw if words.tag is None else commit_of_tag(words.tag)
    name = words.draw if words.tag is None else words.tag
    assert draw is not None and name is not None
    if words.tag is not None and action == "run" and commit_under_test() != draw:
        raise InputError(
            f"another commit than that of the tag {words.tag} is checked out",
            where=COMMAND_LINE,
            hint=f"git checkout {words.tag}",
        )
    return Request(
        action=action,
        name=name,
        draw=draw,
        practice=words.tag is None,
        noise=words.noise,
        draws=words.draws,
        collections=words.collections,
        cases=words.cases,
        jobs=words.jobs,
        cluster=words.cluster,
        limit=words.limit,
        peer_limit=words.peer_limit,
        output=words.output or results_root() / BENCHMARK / folder_name(name),
        document=words.document,
    )


def folder_name(name: str) -> str:
    """Return a tag or text as the name of a folder."""
    return re.sub(r"[^\w.-]", "_", name)[:40]


def _check_choice(what: str, given: str, known: tuple[str, ...]) -> None:
    if given not in known:
        fault = f"there is no {what} {given!r}" if given else f"which {what}?"
        raise InputError(fault, where=COMMAND_LINE, hint=nearest(given, known))
