"""What a stranger's CSV holds: its sensors, and the fields and axes that they stand for."""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dashred.config.schema.types import NAME
from dashred.core.errors import InputError
from dashred.data.io.csv_table import Table, is_number, read_table, separator_hint
from dashred.data.io.reader import read_episodes
from dashred.data.recording import Recording
from dashred.data.sensors import RESERVED
from dashred.physics.expressions.parser import RESERVED as LANGUAGE

OF_A_SENSOR = ("name", "field", "std", "unit")
POINTS = {1: 64, 2: 32}
# More columns than this are hardly the fields of an ODE; and than that, certainly not.
MANY_FIELDS, MOST_FIELDS = 8, 64
# Where a field in space has its spread, this is how far the start is smooth.
SMOOTH = "length"


@dataclass(frozen=True)
class GuessedAxis:
    """An axis of which the sensors' places alone are known; taken for a ring."""

    name: str
    length: float
    points: int

    def wrap(self, place: float, /) -> float:
        """Return the place itself: all that is asked is whether sensors lie on the axis."""
        return place

    @property
    def period(self) -> float:
        """Its length."""
        return self.length

    @property
    def ring_points(self) -> int:
        """Its points."""
        return self.points


@dataclass(frozen=True)
class Guessed:
    """The system that a recording seems to be of: names and places, no equations.

    Attributes:
        axes: as long as the places of the sensors make them; empty for an ODE.
        fields: what the sensors read.
        lets: none.
    """

    axes: tuple[GuessedAxis, ...]
    fields: tuple[str, ...]
    lets: tuple[str, ...] = ()

    @property
    def inputs(self) -> dict[str, str]:
        """No column is taken for an input."""
        return {}

    @property
    def units(self) -> dict[str, str]:
        """No configuration says anything yet."""
        return {}

    @property
    def where(self) -> Callable[[str], str]:
        """Nowhere: there is no configuration."""
        return lambda key: key


def read_own(path: str, sensors_table: str | None) -> tuple[Guessed, list[Recording]]:
    """Read a recording, episode by episode, before anything is said about its system.

    Raises:
        InputError: a reader refuses it, a name cannot stand in an equation, or the table of
            sensors has no places.
    """
    table = read_table(path)
    if "time" not in table.columns:
        raise _without_time(table)
    places = None if sensors_table is None else read_table(sensors_table)
    guessed = _of_columns(table) if places is None else _of_places(places)
    # It is read once more, and may be large.
    del table
    episodes = read_episodes(path, sensors_table, guessed).episodes
    return guessed, [episode.recording for episode in episodes]


def _of_columns(table: Table) -> Guessed:
    fields = tuple(column for column in table.columns if column not in RESERVED)
    if not fields:
        raise InputError("there is no column beside the time", where=table.path)
    if len(fields) > MOST_FIELDS:
        what = f"{len(fields)} columns beside the time: so many are not the fields of an ODE"
        hint = "if they are sensors of a field in space, say where they are: sensors=TABLE.csv"
        raise InputError(what, where=f"{table.path}:{table.header}", hint=f"{hint} (see --help)")
    _check_names(fields, "column", f"{table.path}:{table.header}")
    return Guessed((), fields)


def _of_places(table: Table) -> Guessed:
    for column in ("name", "field"):
        if column not in table.columns:
            hint = "its columns are name, field, one for each coordinate (x, y) and, if known, std"
            problem = f"the table of sensors has no column {column!r}"
            raise InputError(problem, where=table.path, hint=hint)
    coordinates = tuple(column for column in table.columns if column not in OF_A_SENSOR)
    for column in coordinates:
        if not any(is_number(cell) for cell in table.texts(column) if cell):
            hint = f"coordinates are numbers; its other columns may be {', '.join(OF_A_SENSOR)}"
            what = f"the column {column!r} is no coordinate"
            raise InputError(what, where=table.header_location(column), hint=f"{hint}: take it out")
    if len(coordinates) > 2:
        problem = f"{len(coordinates)} coordinates, {', '.join(coordinates)}: 2 are the most"
        raise InputError(problem, where=table.path)
    if not table.rows:
        raise InputError("the table has no sensors", where=table.path)
    fields = tuple(dict.fromkeys(table.texts("field")))
    _check_names((*coordinates, *fields), "name", table.path)
    for field in fields:
        if field in (*coordinates, SMOOTH):
            means = "a coordinate" if field in coordinates else "how smooth the start is"
            what = f"the field {field!r} has the name of {means}"
            hint = f"call it {field}_0 in the column 'field', for example"
            raise InputError(what, where=table.path, hint=hint)
    return Guessed(tuple(_axis(table, name, len(coordinates)) for name in coordinates), fields)


def _axis(table: Table, name: str, rank: int) -> GuessedAxis:
    """Guess an axis: half a mean spacing longer than the sensors reach, in round numbers."""
    places = table.numbers(name)
    for row, place in enumerate(places.tolist()):
        if not place >= 0:
            problem = "a place must be a number from 0 up: axes begin at 0"
            hint = f"shift the coordinates so that the domain begins at {name} = 0"
            raise InputError(problem, where=table.location(row, name), hint=hint)
    distinct = np.unique(places)
    reach = float(distinct[-1])
    spacing = reach / max(1, len(distinct) - 1)
    length = _rounded_up(reach + spacing / 2) if reach else 1.0
    return GuessedAxis(name, length, POINTS[rank])


def _rounded_up(value: float) -> float:
    """Return the next number of two significant digits."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / digit - 1e-9) * digit:.6g}")


def _check_names(names: Sequence[str], kind: str, where: str) -> None:
    for name in names:
        if not NAME.match(name):
            what = f"the {kind} {name!r} cannot be a name in an equation"
            hint = "letters, digits and _, beginning with a letter; a unit in [ ]: 'theta [rad]'"
        elif keyword.iskeyword(name) or name in LANGUAGE:
            what = f"the {kind} {name!r} means something else in an equation"
            hint = f"call it {name}_0 in the header, for example"
        else:
            continue
        raise InputError(what, where=where, hint=hint)


def _without_time(table: Table) -> InputError:
    likely = [c for c in table.columns if c.lower() in ("t", "time", "times", "date", "seconds")]
    hint = separator_hint(table.columns) or f"its columns are {', '.join(table.columns[:12])}"
    if likely:
        hint = f"call the column {likely[0]!r} 'time' in the header"
    return InputError("the recording has no column 'time'", where=table.path, hint=hint)
