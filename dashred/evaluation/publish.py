"""Publish cases without their truths: ``dashred publish draw=SECRET output=DIR truths=FILE``.

The salted truths are written to FILE and only their hashes to DIR. ``check=FILE`` checks claimed
truths in the form of that file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.core.command_line.argument_types import integer_reader, read_path
from dashred.core.command_line.arguments import COMMAND_LINE, Command, argument
from dashred.core.errors import DONE, InputError


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of the command."""

    output: Path = argument(read_path, "DIR", "folder of the published cases, such as conf/proof")
    draw: str | None = argument(str, "SECRET", "what the draw is seeded by", default=None)
    truths: Path | None = argument(read_path, "FILE", "where the truths are kept", default=None)
    cases: int = argument(integer_reader(at_most=100_000), "8", "how many", default="8")
    check: Path | None = argument(
        read_path, "FILE", "claimed truths, instead of draw= and truths=", default=None
    )


COMMAND = Command(
    "dashred publish",
    Arguments,
    "Publishes drawn cases: recordings, configurations, and hashes of what they conceal.",
)


def main(argv: list[str]) -> int:
    """Publish cases, or check claimed truths."""
    words = COMMAND.read(argv)
    if words.check is not None:
        from dashred.evaluation.proof.cases.public import check

        for name, right in check(words.output, words.check).items():
            print(f"{name}: {'the truth' if right else 'not the truth'}")
        return DONE
    if words.draw is None or words.truths is None:
        what = "draw=SECRET and truths=FILE are needed, or check=FILE"
        raise InputError(what, where=COMMAND_LINE, hint="see dashred publish --help")
    from dashred.evaluation.proof.cases.public import publish, select_cases

    publish(select_cases(words.draw, words.cases), words.output, words.truths)
    return DONE
