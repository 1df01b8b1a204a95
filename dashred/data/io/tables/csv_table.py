"""Reading of CSV files into tables of text cells, with line numbers for error messages."""

from __future__ import annotations

import contextlib
import csv
import math
from array import array
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.io.tables.missing_values import MISSING, blank_missing
from dashred.data.io.tables.table_dialect import (
    COMMA,
    DATE,
    TableText,
    find_header,
    remove_thousands_separators,
    write_decimals_with_a_point,
)
from dashred.data.io.tables.table_encoding import other_encoding, refuse_binary
from dashred.data.io.tables.table_header import read_header

# A table takes about thirteen times its size in memory, because every cell is a separate string.
MAX_BYTES = 2**28
# States of a switch, as a logger may write them.
STATES = ("on", "off", "true", "false", "yes", "no", "open", "closed")
SECONDS_AS_NUMBERS = "write times as numbers, for example seconds since the start: 0.25"


@dataclass(frozen=True)
class Table:
    """A rectangular table: ``rows[i][j]`` is the text of row i in ``columns[j]``.

    Attributes:
        path: the file, as given by the user.
        columns: names in the header without units; unique and not empty.
        rows: cells, without the header and blank lines.
        lines: line of the file on which each row ends, counted from 1.
        units: unit of every column whose header states one, as in ``theta [rad]``.
        header: line of the header.
        others: lines of the file between and below the rows that are not rows of the table, and
            are left out.
    """

    path: str
    columns: tuple[str, ...]
    rows: list[list[str]]
    lines: Sequence[int]
    units: dict[str, str] = field(default_factory=dict)
    header: int = 1
    others: tuple[int, ...] = ()

    def __len__(self) -> int:
        """Count of rows, the header left out."""
        return len(self.rows)

    def renamed(self, names: Mapping[str, str]) -> Table:
        """Return the table with other names of some columns: the old name by the new one."""
        new = {old: name for name, old in names.items()}
        columns = tuple(new.get(column, column) for column in self.columns)
        units = {new.get(column, column): unit for column, unit in self.units.items()}
        return replace(self, columns=columns, units=units)

    def without(self, names: Collection[str]) -> Table:
        """Return the table without some columns."""
        kept = [at for at, column in enumerate(self.columns) if column not in names]
        rows = [[row[at] for at in kept] for row in self.rows]
        units = {column: unit for column, unit in self.units.items() if column not in names}
        return replace(self, columns=tuple(self.columns[at] for at in kept), rows=rows, units=units)

    def location(self, row: int, column: str | None = None) -> str:
        """Where a row or a cell stands: ``file.csv:17, column 'theta'``."""
        line = f"{self.path}:{self.lines[row]}"
        return line if column is None else f"{line}, column {column!r}"

    def header_location(self, column: str) -> str:
        """Return the location of a column's header: ``file.csv:1, column 'theta'``."""
        return f"{self.path}:{self.header}, column {column!r}"

    def texts(self, column: str) -> list[str]:
        """Return the cells of a column, stripped."""
        index = self.columns.index(column)
        return [row[index].strip() for row in self.rows]

    def numbers(self, column: str) -> NDArray[np.float64]:
        """Return a column as float64, shape ``(row,)``; an empty cell or NaN is a missing value.

        Raises:
            InputError: at the first cell that is not a number.
        """
        cells = self.texts(column)
        # Convert the whole column at once; search cell by cell only to locate an error.
        if _is_plain("".join(cells)):
            with contextlib.suppress(ValueError):
                return np.array([float(cell or "nan") for cell in cells], dtype=np.float64)
        wrong = [row for row, cell in enumerate(cells) if not is_number(cell)]
        row = next((row for row in wrong if cells[row].lower() not in MISSING), wrong[0])
        hint = "write numbers as 1.5e-3; leave the cell empty where a value is missing"
        if cells[row].lower() in STATES:
            hint = "write a state as a number, such as 1 for ON and 0 for OFF"
        if DATE.match(cells[row]):
            hint = SECONDS_AS_NUMBERS
        problem = f"{_abbreviated(cells[row])} is not a number"
        raise InputError(problem, where=self.location(row, column), hint=hint)


def read_table(path: str) -> Table:
    """Read a file whose first line names the columns.

    The columns are separated by commas, semicolons, tabs or spaces. Decimals may have a comma if
    the separator is another one. Lines that begin with # may precede the header. A unit may follow
    the name of a column in square brackets: ``theta [rad]``.

    Raises:
        InputError: the file is missing, empty, no text or badly quoted; a column has no name, a
            repeated name or an empty unit; or a row has too few or too many cells.
    """
    text, rows, lines = read_cells(path, find_header)
    header = lines.pop(0)
    columns, units = read_header(rows.pop(0), f"{path}:{header}")
    return table_of(path, columns, units, text, rows, lines, header)


def read_cells(
    path: str, find: Callable[[TextIO], TableText], most: int | None = None
) -> tuple[TableText, list[list[str]], array[int]]:
    """Return the cells of a file, and the line on which each row ends; blank lines are left out.

    With ``most``, the file is read up to so many rows.

    Raises:
        InputError: the file is missing, empty, no text or badly quoted.
    """
    try:
        return _read_cells(path, find, most, "utf-8-sig")
    except UnicodeDecodeError:
        return _read_cells(path, find, most, other_encoding(path))


def _read_cells(
    path: str, find: Callable[[TextIO], TableText], most: int | None, encoding: str
) -> tuple[TableText, list[list[str]], array[int]]:
    rows: list[list[str]] = []
    lines = array("q")
    line = 0
    try:
        with _opened(path, encoding) as file:
            text = find(file)
            line = text.skipped
            reader = csv.reader(text.lines, delimiter=text.separator, strict=True)
            for row in islice(reader, most):
                line = text.skipped + reader.line_num
                if row:
                    rows.append(row)
                    lines.append(line)
    except csv.Error as error:
        raise InputError(f"not a readable CSV: {error}", where=f"{path}:{line + 1}") from None
    if not any(len(row) > 1 or row[0].strip() for row in rows):
        raise InputError("the file is empty", where=path)
    return text, rows, lines


def table_of(
    path: str,
    columns: tuple[str, ...],
    units: dict[str, str],
    text: TableText,
    rows: list[list[str]],
    lines: array[int],
    header: int,
) -> Table:
    """Return a table of cells, with a point in its decimals and empty cells for missing values.

    Args:
        path: of the file.
        columns: names of the columns.
        units: of the columns that state one.
        text: how the table is written.
        rows: cells, without those of the header.
        lines: line of each row.
        header: line of the header.

    Raises:
        InputError: a row has another number of cells, or points that may separate thousands.
    """
    check_rectangular(path, columns, rows, lines)
    if text.separator == COMMA:
        remove_thousands_separators(rows)
    else:
        write_decimals_with_a_point(rows, lines, path)
    blank_missing(rows)
    return Table(path, columns, rows, lines, units, header)


@contextlib.contextmanager
def _opened(path: str, encoding: str) -> Iterator[TextIO]:
    try:
        if Path(path).exists() and not Path(path).is_file():
            # Reading a pipe or a device might never end.
            raise InputError("cannot be read: not a regular file", where=path)
        _check_size(path, Path(path).stat().st_size)
        refuse_binary(path)
        with open(path, encoding=encoding, newline="") as file:
            yield file
    except FileNotFoundError:
        raise InputError("no such file", where=path, hint=f"looked in {Path.cwd()}") from None
    except UnicodeDecodeError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", where=path) from None


def _check_size(path: str, size: int) -> None:
    if size <= MAX_BYTES:
        return
    problem = f"the table takes {size / 1e6:.0f} MB; the limit is {MAX_BYTES / 1e6:.0f} MB"
    nth = math.ceil(size / MAX_BYTES)
    thinned = f"keep one row in {nth}, or only the relevant part of the recording"
    hint = f"{thinned}; or convert it to NetCDF (see docs/own-system.md)"
    raise InputError(problem, where=path, hint=hint)


def check_rectangular(
    path: str, columns: Sequence[str], rows: list[list[str]], lines: Sequence[int]
) -> None:
    """Check that every row has a cell for each column.

    Raises:
        InputError: a row has not.
    """
    for index, (row, line) in enumerate(zip(rows, lines, strict=True)):
        if len(row) != len(columns):
            named = "1 column" if len(columns) == 1 else f"{len(columns)} columns"
            problem = f"the row has {len(row)} cells, but the first line names {named}"
            hint = _row_length_hint(columns, row, index)
            raise InputError(problem, where=f"{path}:{line}", hint=hint)


def _row_length_hint(columns: Sequence[str], row: Sequence[str], above: int) -> str:
    """Return a likely reason for a row with the wrong number of cells, below ``above`` others."""
    if len(row) > len(columns) and all(cell.strip() and is_number(cell.strip()) for cell in row):
        return "do the decimals use a comma? Write them with a point, or separate columns with ;"
    if above:
        return "the rows above are as long as the first line: correct this line, or remove it"
    return "the first line must name every column; lines before it must begin with #"


def _is_plain(text: str) -> bool:
    # float() also accepts 1_000 and the digits of other scripts, which are errors in a table.
    return text.isascii() and "_" not in text


def is_number(cell: str) -> bool:
    """Return whether a cell is a number or empty."""
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return _is_plain(cell)


def _abbreviated(cell: str) -> str:
    return repr(cell if len(cell) <= 40 else cell[:37] + "...")
