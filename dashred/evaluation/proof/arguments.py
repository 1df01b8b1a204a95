"""The words of the proof's command line."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from dashred.core.errors import InputError, nearest
from dashred.evaluation.proof.cases.kept_draw import read_draw
from dashred.evaluation.proof.isolation import CHECKOUT
from dashred.evaluation.proof.request import Request

PLACE = "command line"
KNOWN = ("cases", "nulls", "jobs", "output", "draw", "document", "pendulum", "score")
OF_A_DRAW = ("cases", "nulls", "jobs", "output", "draw")
MOST = 100_000

USAGE = """\
usage: python -m dashred.evaluation.prove cases=120 nulls=100 [key=value ...]
       python -m dashred.evaluation.prove score=DIR [document=FILE] [pendulum=FILE]

Draws sealed cases, lets them be analysed by processes that have no way to the truth, freezes the
findings, opens the seals and scores. Cases that are done are not run again: after an interruption,
give the same command again.

  cases=120       how many cases hide something (or, some of them, nothing); default: 12
  nulls=100       how many more hide nothing, a third of them with other troubles; default: 0
  jobs=2          cases at once, each on one core; default: 1
  output=DIR      default: {output}/COMMIT (not tracked by git)
  document=FILE   writes the result as Markdown, its figures beside it; default: DIR/proof.md
  pendulum=FILE   the recording of a real pendulum, for the document's appendix
  score=DIR       scores a finished draw again, with this commit's scorer: its analyses stay as they
                  were frozen, and the document names both commits
  draw=TEXT       draws other cases, for practice: the document says so. By default the hash of the
                  commit under test gives the draw, so that nothing can have been tuned to it

DIR holds a folder a case, with its recording, its frozen findings, the seal that was opened after
that, and `case.json`; beside these, `draw.json` says what was drawn.
"""


def read_words(argv: list[str]) -> Request:
    """Read the command line; ``--help`` prints the usage and exits with 0.

    Raises:
        InputError: an unknown word, a value that cannot be read, or a checkout with changes.
    """
    default = CHECKOUT / "proof"
    if {"--help", "-h"} & set(argv):
        print(USAGE.format(output=default), end="")
        raise SystemExit(0)
    given: dict[str, str] = {}
    for word in argv:
        key, equals, value = word.partition("=")
        if not equals or key not in KNOWN:
            raise InputError(f"unknown word {word!r}", where=PLACE, hint=nearest(key, KNOWN))
        given[key] = value
    if "score" in given:
        return _again(given)
    practice = "draw" in given
    draw = given["draw"] if practice else commit_under_test()
    folder = re.sub(r"[^\w.-]", "_", draw)[:12] or "draw"
    output = Path(given["output"]) if given.get("output") else default / folder
    document = Path(given["document"]) if given.get("document") else output / "proof.md"
    return Request(
        cases=_count("cases", given.get("cases", "12")),
        nulls=_count("nulls", given.get("nulls", "0")),
        jobs=max(1, _count("jobs", given.get("jobs", "1"))),
        output=output.absolute(),
        document=document.absolute(),
        pendulum=_recording(given.get("pendulum")),
        draw=draw,
        practice=practice,
    )


def _again(given: dict[str, str]) -> Request:
    """Read the words that score a kept draw again."""
    if excess := [key for key in OF_A_DRAW if key in given]:
        hint = "the draw itself says how it was made"
        raise InputError(f"score= goes without {excess[0]}=", where=PLACE, hint=hint)
    output = Path(given["score"]).absolute()
    document = Path(given["document"]) if given.get("document") else output / "proof.md"
    return Request(
        **read_draw(output),
        output=output,
        document=document.absolute(),
        pendulum=_recording(given.get("pendulum")),
        scored_by=commit_under_test(),
    )


def commit_under_test() -> str:
    """Return the hash of the commit that is checked out.

    Raises:
        InputError: there is none, or the files are not those of the commit.
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
        raise InputError("this is no git checkout", where=str(CHECKOUT), hint=hint) from None
    if changes:
        raise InputError(
            "files differ from the commit whose hash would draw the cases",
            where=str(CHECKOUT),
            hint=hint,
        )
    return commit


def _recording(text: str | None) -> Path | None:
    if text is None:
        return None
    path = Path(text)
    if not path.is_file():
        raise InputError("there is no such recording", where=text)
    return path.absolute()


def _count(key: str, text: str) -> int:
    if not re.fullmatch(r"\d{1,6}", text) or int(text) > MOST:
        raise InputError(f"{key} must be a whole number, not {text!r}", where=PLACE)
    return int(text)
