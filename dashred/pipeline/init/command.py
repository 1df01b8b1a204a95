"""Write a first configuration for a recording: ``dashred init path=FILE.csv``."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

from dashred.core.argument_types import read_path
from dashred.core.arguments import Command, argument
from dashred.core.errors import DONE, InputError


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of the command."""

    path: Path = argument(
        read_path,
        "FILE.csv",
        "a column `time`, and one for each sensor. Without a table of sensors the columns are the "
        "fields of an ODE: call them what your equations call them",
    )
    sensors: Path | None = argument(
        read_path,
        "TABLE.csv",
        "of sensors in space: columns name (the recording's column), field, x or x and y (from 0 "
        "up) and, if known, std (of the noise)",
        default=None,
    )
    output: Path | None = argument(
        read_path,
        "FILE.yaml",
        "where to write; default: the recording's name with .yaml, in this folder. A file that is "
        "there already is left as it is",
        default=None,
    )


COMMAND = Command(
    "dashred init",
    Arguments,
    """\
Reads a recording and writes a first configuration for it: fields, start, steps as the recording
shows them, every block with what it means, and what is yours to fill in marked TO DO.""",
    after="Then: dashred check conf=FILE.yaml",
)


def main(argv: list[str]) -> int:
    """Read, guess, write."""
    words = COMMAND.read(argv)
    path, table = str(words.path), None if words.sensors is None else str(words.sensors)
    _check_csv(words.path)
    output = words.output or read_path(f"{words.path.stem}.yaml")
    _check_output(output)

    from dashred.config.checks.placeholders import TO_DO
    from dashred.core.files.atomic import write_text_atomic
    from dashred.pipeline.init.columns import MANY_FIELDS, read_own
    from dashred.pipeline.init.document import document
    from dashred.pipeline.init.guess import guess, longest

    guessed, episodes = read_own(path, table)
    seen = [None if file is None else _seen_from(output, file) for file in (path, table)]
    assert seen[0] is not None
    found = guess(guessed, episodes)
    text = document(guessed, longest(episodes), found, seen[0], seen[1], str(output))
    _check_loads(text, output, path)
    try:
        write_text_atomic(output, text)
    except OSError as error:
        what, hint = (
            f"cannot be written: {error.strerror}",
            "choose another place: output=FILE.yaml",
        )
        raise InputError(what, where=str(output), hint=hint) from None
    left = text.count(f"# {TO_DO}:")
    print(f"{output}: fields {', '.join(guessed.fields)}; {left} to do")
    if not guessed.axes and len(guessed.fields) > MANY_FIELDS:
        print("so many columns are hardly the fields of an ODE: if they are sensors of a field in")
        print("space, say where they are: sensors=TABLE.csv (see --help)")
    print(f"next: fill in the lines marked {TO_DO}, then dashred check conf={output}")
    return DONE


def _check_csv(path: Path) -> None:
    """Refuse what is no CSV.

    Raises:
        InputError: what to do instead.
    """
    if path.suffix.lower() != ".csv":
        hint = "a NetCDF recording describes itself: write its configuration after conf/rde.yaml"
        raise InputError("this is not a .csv file", where=str(path), hint=hint)


def _check_output(output: Path) -> None:
    """Refuse a place that is taken, or that no command would read.

    Raises:
        InputError: what to do instead.
    """
    if output.suffix not in (".yaml", ".yml"):
        hint = f"output={output.with_suffix('.yaml')}"
        raise InputError("a configuration's name ends in .yaml", where=str(output), hint=hint)
    if output.exists() or output.is_symlink():
        hint = "name another file with output=FILE.yaml, or remove this one first"
        raise InputError("is there already, and is left as it is", where=str(output), hint=hint)
    if not output.parent.is_dir():
        raise InputError("there is no such folder", where=str(output.parent), hint="make it first")


def _seen_from(output: Path, file: str) -> str:
    """Return a file's path as the configuration has to write it."""
    return Path(os.path.relpath(Path(file).resolve(), output.parent.resolve())).as_posix()


def _check_loads(text: str, output: Path, recording: str) -> None:
    """Hold the text against the loader that will read it.

    Raises:
        InputError: something in the recording is what no configuration can hold.
    """
    from dashred.config import load_config

    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / output.name
        draft.write_text(text, encoding="utf-8")
        try:
            load_config([f"conf={draft}"], entry="init")
        except InputError as error:
            what = f"no configuration can hold what is in it: {error.what}"
            raise InputError(what, where=recording, hint=error.hint) from None
