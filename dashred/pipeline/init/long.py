"""Recognise a table with one row for each reading."""

from __future__ import annotations

from itertools import pairwise

from dashred.core.stated.column_names import SENSOR, VALUE
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.csv_table import is_number
from dashred.data.io.tables.dates import is_date
from dashred.data.io.tables.time_column import TimeColumn

# Beginnings of names of columns that name the sensor of each row, or contain its reading.
SENSOR_NAMES = ("sensor", "variable", "channel", "quantity", "observable", "parameter", "signal")
VALUE_NAMES = ("value", "reading", "measurement", "measured")
# Names of such columns in tables of pharmacology, as NONMEM and Monolix use them.
DVID, DV = "dvid", "dv"
# More different texts than this are remarks, and not sensors.
MAX_SENSORS = 64
# In a table whose headers name its sensors and readings, so many rows may have the time of another.
REPEATED = 0.05
# Sensors that are read in turn change in more than this share of the rows.
IN_TURN = 0.5


def long_columns(table: Columns, time: TimeColumn) -> dict[str, str] | None:
    """Return the columns with the sensors, the readings and, if there are several, the episodes.

    A column of texts names the sensors if its header or that of the readings says so, or if the
    texts take turns. Numbers name them if both headers say so. A row is told from all others by its
    time, its sensor and its episode; where both headers are clear, a few rows may repeat another.

    Args:
        table: of a recording.
        time: its column of times.

    Returns:
        The headers under ``sensor``, ``value`` and ``episode``; None if this is no such table, or
        if it is not clear which column has the readings.
    """
    if not time.columns:
        return None
    others = [column for column in table.columns if column not in time.columns]
    cells = {column: table.texts(column) for column in others}
    numbers = [column for column in others if _are_numbers(cells[column])]
    named = [column for column in numbers if _begins(column, VALUE_NAMES)]
    values = named if named else numbers
    times = list(zip(*(table.texts(column) for column in time.columns), strict=True))
    for sensor in others:
        labels, is_named = cells[sensor], _begins(sensor, SENSOR_NAMES)
        is_clear = is_named and bool(named)
        readings = [column for column in values if column != sensor]
        if len(readings) != 1 or not (_are_labels(labels) or (is_clear and _are_few(labels))):
            continue
        takes_turns = sum(a != b for a, b in pairwise(labels)) > IN_TURN * len(labels)
        if not (named or is_named or takes_turns):
            continue
        keys = [*zip(times, labels, strict=True)]
        found = {SENSOR: sensor, VALUE: readings[0]}
        if len(set(keys)) == len(keys):
            return found
        free = [column for column in others if column not in found.values() and all(cells[column])]
        repeats = {
            episode: len(keys) - len(set(zip(keys, cells[episode], strict=True)))
            for episode in free
            if _are_together(cells[episode])
        }
        episode = min(repeats, key=repeats.__getitem__, default=None)
        if episode is not None and repeats[episode] <= is_clear * REPEATED * len(keys):
            return found if episode == "episode" else {**found, "episode": episode}
    return None


def may_name_sensors(table: Columns, column: str) -> bool:
    """Return whether a column of texts may name the sensor of each row."""
    return _are_labels(table.texts(column))


def _begins(column: str, names: tuple[str, ...]) -> bool:
    name = column.strip().lower()
    own = DVID if names is SENSOR_NAMES else DV
    return name == own or name.startswith(names)


def _are_numbers(cells: list[str]) -> bool:
    return any(cells) and all(map(is_number, cells))


def _are_labels(cells: list[str]) -> bool:
    """Return whether cells are a few texts, each of them in several rows."""
    return _are_few(cells) and not any(is_number(cell) or is_date(cell) for cell in set(cells))


def _are_few(cells: list[str]) -> bool:
    """Return whether there are a few cells that differ, each of them in several rows."""
    return "" not in cells and 1 < len(set(cells)) <= min(MAX_SENSORS, len(cells) // 2)


def _are_together(cells: list[str]) -> bool:
    """Return whether the rows of each episode follow each other."""
    return sum(a != b for a, b in pairwise(cells)) == len(set(cells)) - 1
