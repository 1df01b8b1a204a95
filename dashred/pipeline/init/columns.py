"""Guess the fields and axes of a system from the columns of a CSV recording."""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dashred.config.schema.types import NAME
from dashred.core.errors import InputError
from dashred.data.io.csv_table import Table, is_number, read_table
from dashred.data.io.reader import read_episodes
from dashred.data.io.time_column import find_time_column
from dashred.data.recording import Recording
from dashred.data.sensors import RESERVED
from dashred.physics.expressions.parser import RESERVED as LANGUAGE

SENSOR_COLUMNS = ("name", "field", "std", "unit")
# Grid points of an axis by the number of axes.
POINTS = {1: 64, 2: 32}
# More columns than the first number are probably not the fields of an ODE; more than the second are
# an error.
MANY_FIELDS, MAX_FIELDS = 8, 64
# Key in system.spread of the correlation length of the start, so no field can have this name.
LENGTH = "length"


@dataclass(frozen=True)
class GuessedAxis:
    """A periodic axis, guessed from the positions of the sensors."""

    name: str
    length: float
    points: int

    def wrap(self, place: float, /) -> float:
        """Return the position unchanged, because all sensors are on the guessed axis."""
        return place

    @property
    def period(self) -> float:
        """The length of the axis."""
        return self.length

    @property
    def ring_points(self) -> int:
        """The number of grid points."""
        return self.points

    @property
    def staggered(self) -> bool:
        """False: the guess is periodic."""
        return False


@dataclass(frozen=True)
class GuessedSystem:
    """System without equations, guessed from a recording.

    Attributes:
        axes: axes that contain the positions of the sensors; empty for an ODE.
        fields: names of the fields that the sensors read.
        lets: names of the lets, always empty.
    """

    axes: tuple[GuessedAxis, ...]
    fields: tuple[str, ...]
    lets: tuple[str, ...] = ()

    @property
    def inputs(self) -> dict[str, str]:
        """Empty, because no column is guessed to be an input."""
        return {}

    @property
    def held_inputs(self) -> tuple[str, ...]:
        """Empty, as the inputs."""
        return ()

    @property
    def units(self) -> dict[str, str]:
        """Empty, because there is no configuration yet."""
        return {}

    @property
    def where(self) -> Callable[[str], str]:
        """The key itself, because there is no configuration with line numbers."""
        return lambda key: key


def read_recording(path: str, sensors_table: str | None) -> tuple[GuessedSystem, list[Recording]]:
    """Read a recording without a configuration; return the guessed system and the episodes.

    Raises:
        InputError: the recording or the sensor table is invalid, or a name cannot be used in an
            equation.
    """
    table = read_table(path)
    times = find_time_column(table).columns
    if sensors_table is None:
        guessed = _system_from_columns(table, times)
    else:
        guessed = _system_from_sensors(read_table(sensors_table))
    texts = [column for column in table.columns if _is_text(table, column)]
    ignored = [column for column in texts if column not in (*RESERVED, *times)]
    # The recording is read again below. Free the first copy, because it may be large.
    del table
    episodes = read_episodes(path, sensors_table, guessed, ignored).episodes
    return guessed, [episode.recording for episode in episodes]


def _system_from_columns(table: Table, times: Sequence[str]) -> GuessedSystem:
    others = [column for column in table.columns if column not in (*RESERVED, *times)]
    fields = tuple(column for column in others if not _is_text(table, column))
    if not fields:
        raise InputError("there is no column of numbers besides time", where=table.path)
    if len(fields) > MAX_FIELDS:
        what = f"{len(fields)} columns besides time are too many for the fields of an ODE"
        hint = "if they are sensors of a field in space, give their positions: sensors=TABLE.csv"
        raise InputError(what, where=f"{table.path}:{table.header}", hint=f"{hint} (see --help)")
    _check_names(fields, "column", f"{table.path}:{table.header}")
    return GuessedSystem((), fields)


def _is_text(table: Table, column: str) -> bool:
    """Return whether a column begins with a text, such as a remark or the name of a state."""
    first = next((cell for cell in table.texts(column) if cell), "")
    return not is_number(first)


def _system_from_sensors(table: Table) -> GuessedSystem:
    for column in ("name", "field"):
        if column not in table.columns:
            hint = "its columns are name, field, one for each coordinate (x, y) and, if known, std"
            what = f"the table of sensors has no column {column!r}"
            raise InputError(what, where=table.path, hint=hint)
    coordinates = tuple(column for column in table.columns if column not in SENSOR_COLUMNS)
    for column in coordinates:
        if not any(is_number(cell) for cell in table.texts(column) if cell):
            hint = f"coordinates are numbers; the other columns may be {', '.join(SENSOR_COLUMNS)}"
            what = f"the column {column!r} is not a coordinate"
            raise InputError(what, where=table.header_location(column), hint=f"{hint}: remove it")
    if len(coordinates) > 2:
        listed = ", ".join(coordinates)
        what = f"{len(coordinates)} coordinates ({listed}) are too many: the limit is 2"
        raise InputError(what, where=table.path)
    if not table.rows:
        raise InputError("the table has no sensors", where=table.path)
    fields = tuple(dict.fromkeys(table.texts("field")))
    _check_names((*coordinates, *fields), "name", table.path)
    for field in fields:
        if field in (*coordinates, LENGTH):
            meaning = "a coordinate" if field in coordinates else "a key of system.spread"
            what = f"the field {field!r} has the name of {meaning}"
            hint = f"rename it in the column 'field', for example to {field}_0"
            raise InputError(what, where=table.path, hint=hint)
    return GuessedSystem(
        tuple(_axis(table, name, len(coordinates)) for name in coordinates), fields
    )


def _axis(table: Table, name: str, rank: int) -> GuessedAxis:
    """Guess an axis that ends half a mean spacing after the last sensor, with a rounded length."""
    places = table.numbers(name)
    for row, place in enumerate(places.tolist()):
        if not place >= 0:
            what = "a position must be a number of at least 0, because axes begin at 0"
            hint = f"shift the coordinates so that the domain begins at {name} = 0"
            raise InputError(what, where=table.location(row, name), hint=hint)
    distinct = np.unique(places)
    reach = float(distinct[-1])
    spacing = reach / max(1, len(distinct) - 1)
    length = _rounded_up(reach + spacing / 2) if reach else 1.0
    return GuessedAxis(name, length, POINTS[rank])


def _rounded_up(value: float) -> float:
    """Round up to two significant digits."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / digit - 1e-9) * digit:.6g}")


def _check_names(names: Sequence[str], kind: str, where: str) -> None:
    for name in names:
        if not NAME.match(name):
            what = f"the {kind} {name!r} cannot be a name in an equation"
            hint = (
                "use letters, digits and _, with a letter first; a unit goes in [ ]: 'theta [rad]'"
            )
        elif keyword.iskeyword(name) or name in LANGUAGE:
            what = f"the {kind} {name!r} has another meaning in an equation"
            hint = f"rename it in the header, for example to {name}_0"
        else:
            continue
        raise InputError(what, where=where, hint=hint)
