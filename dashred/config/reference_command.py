"""Write the reference of all configuration keys: ``dashred reference path=docs/config.md``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.config.reference import page
from dashred.core.command_line.argument_types import read_path
from dashred.core.command_line.arguments import Command, argument
from dashred.core.errors import DONE, InputError
from dashred.core.files.atomic import write_text_atomic


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    path: Path | None = argument(
        read_path, "FILE.md", "file to write; default: print the reference", default=None
    )


COMMAND = Command(
    "dashred reference",
    Arguments,
    "Writes the reference of all configuration keys: meaning, type, limits, unit, default.",
)


def main(argv: list[str]) -> int:
    """Write or print the reference."""
    path = COMMAND.read(argv).path
    if path is None:
        print(page())
        return DONE
    try:
        write_text_atomic(path, page())
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", where=str(path)) from None
    print(f"wrote {path}")
    return DONE
