"""Guess the fields and axes of a system from the columns of a CSV recording."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dashred.config.schema.types import NAME
from dashred.core.errors import InputError, nearest
from dashred.core.stated.column_names import SENSOR, VALUE
from dashred.core.stated.record_part import WHOLE, RecordPart
from dashred.core.units import TIME
from dashred.data.checks import MIN_SAMPLES
from dashred.data.clocks.record_part import EmptySensorsError
from dashred.data.io.reader import read_episodes
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.csv_table import Table, is_number, read_table
from dashred.data.io.tables.long_table import widened
from dashred.data.io.tables.table_layout import TIMES, TableLayout, split_header
from dashred.data.io.tables.time_column import TimeColumn, find_time_column, has_dates, read_times
from dashred.data.recording import Recording
from dashred.data.sensors import RESERVED
from dashred.pipeline.init.held import changes_in_steps
from dashred.pipeline.init.layout import has_numbers, is_usable, read_with_guessed_names
from dashred.pipeline.init.long import may_name_sensors

SENSOR_COLUMNS = ("name", "field", "std", "unit")
# Grid points of an axis by the number of axes.
POINTS = {1: 64, 2: 32}
# More columns than the first number are probably not the fields of an ODE; more than the second are
# an error.
MANY_FIELDS, MAX_FIELDS = 8, 64
# A name before the number in a cell: T:85.05, or T=85.05.
LABEL = re.compile(r"[A-Za-z]\w*\s*[:=]\s*(?=[-+.\d])")
# Unit of time for dates, by the shortest step in seconds.
TIME_UNITS = {"d": 0.5 * 86400.0, "h": 600.0, "min": 10.0, "s": 0.0}
# Key in system.spread of the correlation length of the start, so no field can have this name.
LENGTH = "length"


@dataclass(frozen=True)
class GuessedAxis:
    """A periodic axis, guessed from the positions of the sensors."""

    name: str
    length: float
    points: int

    @property
    def begin(self) -> float:
        """The beginning of the axis."""
        return 0.0

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
        lets: columns that are functions of the state.
        inputs: column of each input, by name: that of the column.
        held_inputs: columns of inputs that change in steps.
        left_out: columns of numbers that are no fields: a counter of the rows, a constant.
        of_episodes: columns that are no fields, with one value in each of several episodes.
        empty: columns that are left out, because they are empty in the part that is used.
        units: a unit of time for dates.
        texts: columns that are left out, but may name the sensor of each row.
        row_numbers: column that was taken for the times, but may only count the rows.
    """

    axes: tuple[GuessedAxis, ...]
    fields: tuple[str, ...]
    lets: tuple[str, ...] = ()
    inputs: dict[str, str] = field(default_factory=dict)
    held_inputs: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    of_episodes: tuple[str, ...] = ()
    empty: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    texts: tuple[str, ...] = ()
    row_numbers: str | None = None

    def contains(self, place: Sequence[float], /) -> bool:
        """True: the axes are the whole domain."""
        return True

    @property
    def where(self) -> Callable[[str], str]:
        """The key itself, because there is no configuration with line numbers."""
        return lambda key: key


def read_recording(
    path: str,
    sensors_table: str | None,
    inputs: Sequence[str] = (),
    part: RecordPart = WHOLE,
    ignored: Sequence[str] = (),
) -> tuple[GuessedSystem, list[Recording], TableLayout]:
    """Read a recording without a configuration.

    Args:
        path: of the recording.
        sensors_table: path of the table of sensors; None for an ODE.
        inputs: columns that are inputs, by their name in the file or in the configuration.
        part: the samples that are used.
        ignored: columns that are not read, by their name in the file or in the configuration.

    Returns:
        The guessed system, the episodes, and what a configuration has to say about the table.

    Raises:
        InputError: the recording or the sensor table is invalid, or a name cannot be used in an
            equation.
    """
    own, layout = read_with_guessed_names(path, sensors_table is None, ignored)
    unread = tuple(_column(own, layout, name, "ignore") for name in ignored)
    time = find_time_column(own, layout.step, unread)
    layout = replace(layout, part=part, ignored=unread)
    table: Columns = own
    if {SENSOR, VALUE} <= set(layout.headers):
        driven = GuessedSystem((), (), inputs={name: name for name in inputs})
        table = widened(own, time, StatedUnits(driven), layout)
    times = time.columns
    driving = {name: name for name in (_column(table, layout, n, "inputs") for n in inputs)}
    _check_names([*driving], "input", path)
    for name in unread:
        if name in (*RESERVED, *times, *driving):
            problem = f"the column {name!r} is needed: times, episodes and inputs are read"
            raise InputError(problem, where="ignore")
    if sensors_table is None:
        guessed = _system_from_columns(table, (*times, *driving, *unread))
    else:
        guessed = _system_from_sensors(read_table(sensors_table))
    held = tuple(name for name in driving if changes_in_steps(table.numbers(name)))
    guessed = replace(guessed, inputs=driving, held_inputs=held)
    if unit := _unit_of_dates(table, time, guessed):
        guessed = replace(guessed, units={TIME: unit})
    texts = [column for column in table.columns if not has_numbers(table, column)]
    texts = [column for column in texts if column not in (*RESERVED, *times, *unread)]
    unclear = tuple(column for column in texts if may_name_sensors(table, column))
    guessed = replace(guessed, texts=unclear)
    if (header := layout.headers.get(TIMES[0])) is not None and not has_dates(table, time):
        is_count = _counts_rows(table.numbers(time.last)) and time.last not in table.units
        guessed = replace(guessed, row_numbers=header if is_count else None)
    # The recording is read again below. Free the first copy, because it may be large.
    del own, table
    ignored = [*unread, *texts]
    try:
        read = read_episodes(path, sensors_table, guessed, replace(layout, ignored=ignored))
    except EmptySensorsError as error:
        guessed = _without(guessed, error)
        ignored += guessed.empty
        read = read_episodes(path, sensors_table, guessed, replace(layout, ignored=ignored))
    return guessed, [episode.recording for episode in read.episodes], layout


def _without(guessed: GuessedSystem, error: EmptySensorsError) -> GuessedSystem:
    """Return an ODE system without the fields of empty columns.

    Raises:
        EmptySensorsError: the sensors are in space, or no field is left.
    """
    fields = tuple(name for name in guessed.fields if name not in error.names)
    if guessed.axes or not fields:
        raise error
    return replace(guessed, fields=fields, empty=error.names)


def _column(table: Columns, layout: TableLayout, name: str, argument: str) -> str:
    """Return the name of a column that an argument of the command names.

    Raises:
        InputError: the recording does not have it.
    """
    renamed = {header: own for own, header in layout.headers.items()}
    for candidate in (name, renamed.get(name), renamed.get(split_header(name)[0])):
        if candidate in table.columns:
            return candidate
    hint = nearest(name, [*table.columns, *renamed])
    raise InputError(f"the recording has no column {name!r}", where=argument, hint=hint)


def _unit_of_dates(table: Columns, time: TimeColumn, guessed: GuessedSystem) -> str | None:
    """Return a unit of time in which samples are some hundredths to tens apart; None for numbers.

    Dates without a unit would be in seconds.
    """
    if not has_dates(table, time):
        return None
    steps = np.diff(read_times(table, time, StatedUnits(guessed)).values)
    known = np.abs(steps[np.isfinite(steps)])
    step = float(np.median(known)) if len(known) else 1.0
    return next(unit for unit, shortest in TIME_UNITS.items() if step >= shortest)


def _counts_rows(values: NDArray[np.float64]) -> bool:
    """Return whether a column counts the rows: 1, 2, 3, or the days of a year: 182, 183, 184."""
    if len(values) < 2 or not np.isfinite(values).all():
        return False
    is_count = bool((np.diff(values) == 1).all()) and float(values[0]).is_integer()
    return is_count and (values[0] in (0, 1) or len(values) >= MIN_SAMPLES)


def _system_from_columns(table: Columns, others: Sequence[str]) -> GuessedSystem:
    """Return an ODE system of all columns of numbers besides some ``others``."""
    columns = [column for column in table.columns if column not in (*RESERVED, *others)]
    numbers = [column for column in columns if has_numbers(table, column)]
    no_fields = [column for column in numbers if _is_no_field(table, column)]
    # A recording of a state at rest is one all the same.
    no_fields = no_fields if len(no_fields) < len(numbers) else []
    fields = tuple(column for column in numbers if column not in no_fields)
    of_episodes = tuple(column for column in no_fields if _differs(table.numbers(column)))
    left_out = tuple(column for column in no_fields if column not in of_episodes)
    if not fields:
        hint = None
        labelled = (cell for name in columns for cell in table.texts(name)[:1] if LABEL.match(cell))
        if (cell := next(labelled, None)) is not None:
            number = LABEL.sub("", cell)
            hint = f"write the number alone, {number} in place of {cell}, and name the columns"
        raise InputError("there is no column of numbers besides time", where=table.path, hint=hint)
    if len(fields) > MAX_FIELDS:
        what = f"{len(fields)} columns besides time are too many for the fields of an ODE"
        hint = "if they are sensors of a field in space, give their positions: sensors=TABLE.csv"
        raise InputError(what, where=table.header_location(fields[0]), hint=f"{hint} (see --help)")
    _check_names(fields, "column", table.path)
    return GuessedSystem((), fields, left_out=left_out, of_episodes=of_episodes)


def _differs(values: NDArray[np.float64]) -> bool:
    """Return whether a column that is no field differs between the episodes."""
    return not _counts_rows(values) and len(np.unique(values)) > 1


def _is_no_field(table: Columns, column: str) -> bool:
    """Return whether a column counts the rows, or is constant in each episode."""
    values = table.numbers(column)
    if _counts_rows(values):
        return True
    runs = table.texts("episode") if "episode" in table.columns else [""] * len(table)
    first: dict[str, float] = {}
    return all(first.setdefault(run, v) == v for run, v in zip(runs, values.tolist(), strict=True))


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
    for read in fields:
        if read in (*coordinates, LENGTH):
            meaning = "a coordinate" if read in coordinates else "a key of system.spread"
            what = f"the field {read!r} has the name of {meaning}"
            hint = f"rename it in the column 'field', for example to {read}_0"
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
        if is_usable(name):
            continue
        what = f"the {kind} {name!r} cannot be a name in an equation"
        hint = "use letters, digits and _, with a letter first; a unit goes in [ ]: 'theta [rad]'"
        if NAME.match(name):
            what = f"the {kind} {name!r} has another meaning in an equation"
            hint = f"rename it in the header, for example to {name}_0"
        raise InputError(what, where=where, hint=hint)
