"""Guess the fields and inputs of a system from the columns of a recording."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError, nearest
from dashred.core.stated.column_names import LONG, SENSOR, VALUE
from dashred.core.stated.record_part import WHOLE, RecordPart
from dashred.core.units import TIME
from dashred.data.checks import MIN_SAMPLES
from dashred.data.clocks.record_part import EmptySensorsError
from dashred.data.io.reader import read_episodes
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.csv_table import read_table
from dashred.data.io.tables.table_layout import TIMES, TableLayout, split_header
from dashred.data.io.tables.tidy.long_table import widened
from dashred.data.io.tables.time_column import TimeColumn, find_time_column, has_dates, read_times
from dashred.data.recording import Recording
from dashred.data.sensors import RESERVED
from dashred.pipeline.init.guessed_system import NONE_CHOSEN, ChosenColumns, GuessedSystem
from dashred.pipeline.init.held import changes_in_steps
from dashred.pipeline.init.layout import check_names, has_numbers, read_with_guessed_names
from dashred.pipeline.init.long import may_name_sensors
from dashred.pipeline.init.sensor_axes import (
    place_columns,
    system_from_places,
    system_from_sensors,
)

# More columns than the first number are probably not the fields of an ODE; more than the second are
# an error.
MANY_FIELDS, MAX_FIELDS = 8, 64
# A name before the number in a cell: T:85.05, or T=85.05.
LABEL = re.compile(r"[A-Za-z]\w*\s*[:=]\s*(?=[-+.\d])")
# Unit of time for dates, by the shortest step in seconds.
TIME_UNITS = {"d": 0.5 * 86400.0, "h": 600.0, "min": 10.0, "s": 0.0}


def read_recording(
    path: str,
    sensors_table: str | None,
    chosen: ChosenColumns = NONE_CHOSEN,
    part: RecordPart = WHOLE,
) -> tuple[GuessedSystem, list[Recording], TableLayout]:
    """Read a recording without a configuration.

    Args:
        path: of the recording.
        sensors_table: path of the table of sensors; None for an ODE.
        chosen: what the user says of the columns.
        part: the samples that are used.

    Returns:
        The guessed system, the episodes, and what a configuration has to say about the table.

    Raises:
        InputError: the recording or the sensor table is invalid, or a name cannot be used in an
            equation.
    """
    own, layout = read_with_guessed_names(path, sensors_table is None, chosen.ignored)
    unread = tuple(_column(own, layout, name, "ignore") for name in chosen.ignored)
    time = find_time_column(own, layout.step, unread)
    layout = replace(layout, part=part, ignored=unread)
    table: Columns = own
    if {SENSOR, VALUE} <= set(layout.headers):
        driven = GuessedSystem((), (), inputs={name: name for name in chosen.inputs})
        table = widened(own, time, StatedUnits(driven), layout)
    axes = place_columns(own, time) if sensors_table is None else ()
    times = (*time.columns, *axes)
    driving = [_column(table, layout, name, "inputs") for name in chosen.inputs]
    check_names(driving, "input", path)
    wanted = [_column(table, layout, name, "fields") for name in chosen.fields]
    if wanted and sensors_table is not None:
        hint = "omit fields="
        raise InputError("the table of sensors names the fields", where="fields", hint=hint)
    for name in unread:
        if name in (*RESERVED, *times, *driving, *wanted):
            problem = f"the column {name!r} is needed: times, episodes, fields and inputs are read"
            raise InputError(problem, where="ignore")
    if wanted:
        guessed = _system_of_fields(table, wanted, (*RESERVED, *times, *driving))
        used = {*LONG, *RESERVED, *times, *driving, *wanted, *unread}
        headers = {name: header for name, header in layout.headers.items() if name in used}
        layout = replace(layout, headers=headers)
    elif sensors_table is None:
        guessed = _system_from_columns(table, (*times, *driving, *unread))
    else:
        guessed = system_from_sensors(read_table(sensors_table))
    if axes:
        guessed = system_from_places(guessed, own, axes)
    held = tuple(name for name in driving if changes_in_steps(table.numbers(name)))
    inputs = {name: name for name in driving}
    guessed = replace(guessed, inputs=inputs, held_inputs=held, others=own.others)
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
    bare = split_header(name)[0]
    for candidate in (name, renamed.get(name), bare, renamed.get(bare)):
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
        hint = "a recording is a table with a column of times and one for each sensor"
        labelled = (cell for name in columns for cell in table.texts(name)[:1] if LABEL.match(cell))
        if (cell := next(labelled, None)) is not None:
            number = LABEL.sub("", cell)
            hint = f"write the number alone, {number} in place of {cell}, and name the columns"
        raise InputError("there is no column of numbers besides time", where=table.path, hint=hint)
    if len(fields) > MAX_FIELDS:
        what = f"{len(fields)} columns besides time are too many for the fields of an ODE"
        hint = f"choose some of them: fields={fields[0]},{fields[1]}; if they are sensors of a "
        hint += "field in space, give their positions: sensors=TABLE.csv (see --help)"
        raise InputError(what, where=table.header_location(fields[0]), hint=hint)
    check_names(fields, "column", table.path)
    return GuessedSystem((), fields, left_out=left_out, of_episodes=of_episodes)


def _system_of_fields(
    table: Columns, fields: Sequence[str], others: Sequence[str]
) -> GuessedSystem:
    """Return an ODE system of the fields that the user names.

    Raises:
        InputError: one of them is among the ``others``, or cannot be a name in an equation.
    """
    for name in fields:
        if name in others:
            problem = f"the column {name!r} is not a field: it has times, episodes or an input"
            raise InputError(problem, where="fields")
    check_names(fields, "column", table.path)
    return GuessedSystem((), tuple(fields))


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
