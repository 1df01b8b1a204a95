"""Write the page of every configuration key: ``dashred reference path=docs/config.md``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.config.reference import page
from dashred.core.argument_types import read_path
from dashred.core.arguments import Command, word
from dashred.core.errors import DONE, InputError
from dashred.core.files.atomic import write_text_atomic


@dataclass(frozen=True, kw_only=True)
class Words:
    """The words of the command."""

    path: Path | None = word(
        read_path, "FILE.md", "the file; default: print the page", default=None
    )


COMMAND = Command(
    "dashred reference",
    Words,
    "Writes the page of every configuration key: meaning, type, limits, unit, default.",
)


def main(argv: list[str]) -> int:
    """Write the page, or print it."""
    path = COMMAND.read(argv).path
    if path is None:
        print(page())
        return DONE
    try:
        write_text_atomic(path, page())
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", where=str(path)) from None
    print(f"{path} is written")
    return DONE
