"""Write a first configuration for a recording: ``dashred init path=FILE.csv``."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from dashred.core.command_line.argument_types import NUMBER, list_reader, read_path
from dashred.core.command_line.arguments import Command, argument
from dashred.core.errors import DONE, InputError
from dashred.core.stated.record_part import parse_part
from dashred.data.io.tables.table_dialect import NETCDF


def _read_time(text: str) -> float | str:
    """Read a number; another text is a date."""
    return float(text) if NUMBER.match(text) else text


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    path: Path = argument(
        read_path,
        "FILE.csv",
        "recording with a column `time` and one for each sensor. Without a sensor table the "
        "columns are the fields of an ODE: give them the names that your equations use",
    )
    sensors: Path | None = argument(
        read_path,
        "TABLE.csv",
        "table of sensors in space with the columns name (the column of the recording), field, "
        "x or x and y (at least 0) and, if known, std (of the noise)",
        default=None,
    )
    inputs: tuple[str, ...] | None = argument(
        list_reader(str),
        "NAME,...",
        "columns that drive the system, such as a voltage or the weather: inputs, not fields",
        default=None,
    )
    fields: tuple[str, ...] | None = argument(
        list_reader(str),
        "NAME,...",
        "columns that are the fields of an ODE, if not all are: the others are left out",
        default=None,
    )
    ignore: tuple[str, ...] | None = argument(
        list_reader(str),
        "NAME,...",
        "columns that are left out, such as a set point: neither fields nor inputs",
        default=None,
    )
    begin: float | str | None = argument(
        _read_time,
        "TIME",
        "first time of the part that is used, without a start-up for example: a number in the unit "
        "of time of the recording, or a date as in the recording",
        default=None,
    )
    end: float | str | None = argument(
        _read_time, "TIME", "last time of the part that is used, like begin", default=None
    )
    output: Path | None = argument(
        read_path,
        "FILE.yaml",
        "configuration to write; default: the name of the recording with .yaml, in this folder. "
        "An existing file is not overwritten",
        default=None,
    )


COMMAND = Command(
    "dashred init",
    Arguments,
    """\
Reads a recording and writes a first configuration for it. The fields, the start and the time steps
are guessed from the recording. Comments explain each block, and TO DO marks the lines that you must
fill in.""",
    after="Then: dashred check conf=FILE.yaml",
)


def main(argv: list[str]) -> int:
    """Read the recording and write its first configuration."""
    words = COMMAND.read(argv)
    path, table = str(words.path), None if words.sensors is None else str(words.sensors)
    _check_table(words.path)
    part = parse_part(words.begin, words.end, lambda key: key.rpartition(".")[2])
    output = words.output or read_path(f"{words.path.stem}.yaml")
    _check_output(output)

    from dashred.config.checks.placeholders import TO_DO
    from dashred.core.files.atomic import write_text_atomic
    from dashred.core.stated.column_names import SENSOR
    from dashred.data.io.tables.recording_table import unclear_groups
    from dashred.pipeline.init.columns import MANY_FIELDS, read_recording
    from dashred.pipeline.init.document import document
    from dashred.pipeline.init.guess import guess_values, longest_episode
    from dashred.pipeline.init.guessed_system import ChosenColumns
    from dashred.pipeline.init.relations import accelerations

    chosen = ChosenColumns(words.inputs or (), words.fields or (), words.ignore or ())
    guessed, episodes, layout = read_recording(path, table, chosen, part)
    values = guess_values(guessed, episodes)
    lets = accelerations(values.rates)
    fields = tuple(field for field in guessed.fields if field not in lets)
    guessed = replace(guessed, fields=fields, lets=lets)
    text = document(
        guessed,
        longest_episode(episodes),
        values,
        _relative_path(output, path),
        None if table is None else _relative_path(output, table),
        layout,
        str(output),
    )
    _check_loads(text, output, path)
    try:
        write_text_atomic(output, text)
    except OSError as error:
        what = f"cannot be written: {error.strerror}"
        hint = "choose another file: output=FILE.yaml"
        raise InputError(what, where=str(output), hint=hint) from None
    if guessed.others:
        first, count = guessed.others[0], len(guessed.others)
        which = f"line {first}" if count == 1 else f"{count} lines, the first is line {first}"
        print(f"left out: {which} (not a row of the table)")
    if guessed.left_out:
        print(f"left out: {', '.join(guessed.left_out)} (constant, or a count of the rows)")
    if guessed.of_episodes:
        listed = ",".join(guessed.of_episodes)
        print(f"left out: {', '.join(guessed.of_episodes)} (one value in each episode). If an")
        print(f"equation needs them, they are inputs: inputs={listed}")
    if guessed.empty:
        print(f"left out: {', '.join(guessed.empty)} (no values in the part that is used)")
    if SENSOR in layout.headers:
        print(f"one row for each reading: column {layout.headers[SENSOR]} names its sensor")
    if guessed.axes and table is None:
        listed = ", ".join(axis.name for axis in guessed.axes)
        print(f"one row for each time and place: the place is in {listed}")
    if groups := unclear_groups(path):
        print(f"the groups of columns, {', '.join(groups)}, are read as episodes")
    if guessed.texts:
        print(f"left out: {', '.join(guessed.texts)} (text). If one names the sensor of each row:")
        print("recording.columns={sensor: NAME, value: COLUMN}, see docs/own-system.md")
        print("An input must have numbers, such as 1 for on and 0 for off")
    if guessed.row_numbers is not None:
        name = guessed.row_numbers
        print(
            f"times: {name}, which may only count the rows. Then ignore={name}, and recording.every"
        )
        print("is the time from row to row")
    if lets:
        print(f"{', '.join(lets)}: the rate of a rate is a let, and not a field")
    left = text.count(f"# {TO_DO}:")
    print(f"{output}: fields {', '.join(guessed.fields)}; {left} to do")
    if not guessed.axes and len(guessed.fields) > MANY_FIELDS:
        print("These are many columns for the fields of an ODE: choose some, fields=NAME,...")
        print("If they are sensors of a field in space, give their positions: sensors=TABLE.csv")
    print(f"next: fill in the lines marked {TO_DO}, then dashred check conf={output}")
    return DONE


def _check_table(path: Path) -> None:
    """Check that the recording is a table.

    Raises:
        InputError: it is not.
    """
    if path.suffix.lower() == NETCDF:
        hint = "for a NetCDF recording, write the configuration by hand: see conf/rde.yaml"
        raise InputError("this is not a table of text", where=str(path), hint=hint)


def _check_output(output: Path) -> None:
    """Check that the configuration can be written.

    Raises:
        InputError: the name does not end in .yaml, the file exists, or its folder does not exist.
    """
    if output.suffix not in (".yaml", ".yml"):
        hint = f"output={output.with_suffix('.yaml')}"
        raise InputError(
            "the name of a configuration must end in .yaml", where=str(output), hint=hint
        )
    if output.exists() or output.is_symlink():
        hint = "choose another file with output=FILE.yaml, or remove this one first"
        raise InputError("this file already exists", where=str(output), hint=hint)
    if not output.parent.is_dir():
        raise InputError(
            "there is no such folder", where=str(output.parent), hint="create it first"
        )


def _relative_path(output: Path, file: str) -> str:
    """Return the path of a file relative to the configuration, which is how it refers to it."""
    return Path(os.path.relpath(Path(file).resolve(), output.parent.resolve())).as_posix()


def _check_loads(text: str, output: Path, recording: str) -> None:
    """Check that the configuration can be loaded.

    Raises:
        InputError: the recording contains something that a configuration cannot express.
    """
    from dashred.config import load_config

    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / output.name
        draft.write_text(text, encoding="utf-8")
        try:
            load_config([f"conf={draft}"], entry="init")
        except InputError as error:
            what = f"its configuration would be invalid: {error.what}"
            raise InputError(what, where=recording, hint=error.hint) from None
