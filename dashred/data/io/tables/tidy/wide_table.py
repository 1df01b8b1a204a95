"""A table with several rows for each time, seen as one with a column for each sensor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.time_column import TimeColumn

# No row has a value for this cell.
EMPTY = -1


@dataclass(frozen=True, eq=False)
class WideTable:
    """A table with several rows for each time as one with one, and with a column for each sensor.

    Attributes:
        source: the table with several rows.
        columns: of the times, the episodes and the inputs, and the sensors.
        units: of the columns.
        cells: source column and source row of every cell, ``(row,)``, by column.
    """

    source: Columns
    columns: tuple[str, ...]
    units: Mapping[str, str]
    cells: Mapping[str, tuple[str, NDArray[np.intp]]] = field(repr=False)

    @property
    def path(self) -> str:
        """What messages call the table."""
        return self.source.path

    def __len__(self) -> int:
        """Count of times, of all episodes."""
        return len(next(iter(self.cells.values()))[1])

    def location(self, row: int, column: str | None = None) -> str:
        """Where a cell stands; of a row, or an empty cell, the first reading of this time."""
        first = self.cells[self.columns[0]]
        origin, rows = first if column is None else self.cells.get(column, first)
        if rows[row] == EMPTY:
            origin, rows = first
        return self.source.location(int(rows[row]), None if column is None else origin)

    def header_location(self, column: str) -> str:
        """Where the name of a column stands."""
        return self.source.header_location(self.cells[column][0])

    def texts(self, column: str) -> list[str]:
        """The column's cells as texts; an empty text is a missing value."""
        origin, rows = self.cells[column]
        cells = self.source.texts(origin)
        return ["" if row == EMPTY else cells[row] for row in rows.tolist()]

    def numbers(self, column: str) -> NDArray[np.float64]:
        """The column as float64, shape (row,); NaN is a missing value.

        Raises:
            InputError: there is a cell that is not a number.
        """
        origin, rows = self.cells[column]
        if origin not in self._parsed:
            self._parsed[origin] = self.source.numbers(origin)
        return np.where(rows == EMPTY, np.nan, self._parsed[origin][rows])

    @cached_property
    def _parsed(self) -> dict[str, NDArray[np.float64]]:
        """Values of the source columns that were read, ``(row,)`` each."""
        return {}


def distinct_times(
    table: Columns, times: NDArray[np.float64], read: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first row of each time of each episode, and the time to which each row belongs.

    Args:
        table: with several rows for each time.
        times: of its rows, ``(row,)``.
        read: rows that have a reading.

    Returns:
        Rows of the table, ``(time,)``; and indices of times, ``(read row,)``.
    """
    labels = table.texts("episode") if "episode" in table.columns else [""] * len(table)
    numbers = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    keys = np.stack([[numbers[label] for label in labels], times], axis=1)[read]
    _, firsts, at = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return read[firsts], at.reshape(-1)


def repeated_row(rows: NDArray[np.intp], at: NDArray[np.intp]) -> int | None:
    """Return the first of some rows that has the time of an earlier one; None if there is none.

    Args:
        rows: of one sensor or place.
        at: time of each, from :func:`distinct_times`.
    """
    _, first = np.unique(at, return_index=True)
    again = np.setdiff1d(np.arange(len(at)), first)
    return int(rows[again[0]]) if again.size else None


def shared_cells(
    table: Columns,
    time: TimeColumn,
    inputs: Iterable[str],
    read: NDArray[np.intp],
    firsts: NDArray[np.intp],
    at: NDArray[np.intp],
) -> dict[str, tuple[str, NDArray[np.intp]]]:
    """Return the cells of the columns that have one value at each time: times, episodes, inputs.

    Args:
        table: with several rows for each time.
        time: its column of times.
        inputs: columns that drive the system.
        read: rows that have a reading.
        firsts: first row of each time, from :func:`distinct_times`.
        at: time of each row that is read, from :func:`distinct_times`.

    Raises:
        InputError: an input has two values at one time.
    """
    kept = [name for name in table.columns if name in (*time.columns, "episode")]
    driving = [name for name in inputs if name in table.columns]
    for name in driving:
        _check_one_value(table, name, read, firsts[at])
    return {name: (name, firsts) for name in dict.fromkeys((*kept, *driving))}


def _check_one_value(
    table: Columns, column: str, rows: NDArray[np.intp], firsts: NDArray[np.intp]
) -> None:
    """Check that an input has one value at each time.

    Raises:
        InputError: it has two.
    """
    cells = np.array(table.texts(column))
    other = np.flatnonzero(cells[rows] != cells[firsts])
    if other.size:
        row = int(rows[other[0]])
        problem = f"the input has another value at this time, {str(cells[firsts[other[0]]])!r}"
        hint = "give it one value at each time"
        raise InputError(problem, where=table.location(row, column), hint=hint)
