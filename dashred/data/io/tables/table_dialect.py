"""How a table of text is written: the lines before its header, its separators and its decimals."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import TextIO

from dashred.core.errors import InputError
from dashred.core.unit_conversion import is_known_unit
from dashred.data.io.tables.grouped_columns import ColumnGroups, find_groups

# Ending of the files that are no tables of text; any other file is read as one.
NETCDF = ".nc"
COMMENT = "#"
COMMA, SPACE = ",", " "
# Separators in the order in which they are looked for in the header.
SEPARATORS = ("\t", ";", COMMA)
QUOTED = re.compile(r'"[^"]*"')
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d+)?")
ENGLISH_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?")
# 2024-05-17, 17.05.24, 5/17/2024, 17-May-24, 12:30, 1.12:30, 1 day, 12:30.
DATE = re.compile(
    r"\d{1,4}([-/.])\d{1,2}\1\d{1,4}|(\d+(\.| days?,? ))?\d{1,3}:\d{2}|"
    r"\d{1,2}[ -][A-Za-z]{3,9}[ -]\d{2,4}"
)
# Rows that are searched for decimal commas, and lines that are searched for the header.
HEAD, HEAD_LINES = 100, 60
# Lines that show which columns have numbers.
FEW_LINES = 8


@dataclass(frozen=True)
class TableText:
    """The lines of a table from its header on.

    Attributes:
        lines: the header, if there is one, and the rows.
        separator: between the cells.
        skipped: number of lines before the first of ``lines``.
        below_header: number of lines between the header and the rows, such as one with units.
        has_header: whether the first line is the header.
        groups: of columns, each with the times and the readings of one run; None for one group.
    """

    lines: Iterator[str]
    separator: str
    skipped: int
    below_header: int = 0
    has_header: bool = True
    groups: ColumnGroups | None = None


def find_header(file: Iterator[str]) -> TableText:
    """Skip blank lines and comments at the beginning of a file, and find the separator.

    A comment directly above a row of numbers is the header, as ``numpy.savetxt`` writes it.
    """
    skipped, comment = 0, ""
    for line in file:
        if _is_content(line):
            break
        skipped += 1
        comment = line.lstrip(COMMENT).strip()
    else:
        return TableText(iter(()), COMMA, skipped)
    separator = _separator(line)
    cells = _cells(line, separator)
    if (
        comment
        and len(_cells(comment, separator)) == len(cells)
        and all(map(is_number_cell, cells))
    ):
        return TableText(_rows([f"{comment}\n", line], file, separator), separator, skipped - 1)
    return TableText(_rows([line], file, separator), separator, skipped)


def find_recording(file: TextIO) -> TableText:
    """Find the header of a recording, which a logger may write between other lines.

    The rows begin with the first line whose first cell is a number or a date. The header is the
    first of the lines directly above that have as many cells, none of them empty or repeated. Lines
    before it are skipped, and lines below it, such as one with the units, are counted. Without such
    rows, columns of numbers beside others are read, or else the first line is the header.
    """
    head = list(islice(file, HEAD_LINES))
    lines = chain(head, file)
    begin = next((i for i, line in enumerate(head) if _is_content(line)), len(head))
    first = next((i for i in range(begin, len(head)) if _begins_with_a_value(head[i])), None)
    if first is None:
        beside = _columns_beside_text(head[begin:])
        if not beside:
            return find_header(lines)
        separator = _separator(head[begin])
        chosen = _chosen_columns(chain(head[begin:], file), separator, beside)
        return TableText(chosen, separator, begin, has_header=False)
    if first == begin:
        found = find_header(lines)
        others = _cells(head[first], found.separator)[1:]
        # The only cell of a line is a value here.
        names_others = bool(others) and not any(map(is_value_cell, others))
        is_named = found.skipped < begin or names_others
        return replace(found, has_header=is_named)
    separator = _separator(head[first])
    rows = [_cells(line, separator) for line in head[: first + 1]]
    # Blank lines may follow the header.
    end = next((i for i in range(first, begin, -1) if head[i - 1].strip()), begin)
    top = end
    # The last columns may be empty, such as one for comments: then rows may be shorter.
    width = len(rows[first])
    if end > begin and _names_all(rows[end - 1]) and "" not in rows[end - 1]:
        width = max(width, len(rows[end - 1]))
    while top > begin and len(rows[top - 1]) == width:
        top -= 1
    for i in range(top, end):
        groups = find_groups(rows[i - 1] if i > top else [], rows[i])
        if groups is not None:
            below = _rows(head[i:], file, separator)
            return TableText(below, separator, i, end - i - 1, groups=groups)
    named = [i for i in range(top, end) if _names_all(rows[i])]
    header = next(iter(named), first)
    # A line with numbers below the header is a row, whatever its first cell, unless names follow:
    # then it is a setting of the logger, and settings without numbers may follow it.
    with_numbers = (i for i in range(end - 1, header, -1) if any(map(is_number_cell, rows[i])))
    if (last := next(with_numbers, None)) is not None:
        later = [i for i in named if i > last]
        apart = [i for i in later if not all(map(_is_unit, rows[i]))]
        header = next(reversed(apart or later), first)
    if header == first:
        return find_header(lines)
    below = _rows(head[header:], file, separator)
    return TableText(below, separator, header, end - header - 1)


def _columns_beside_text(lines: Sequence[str]) -> list[int]:
    """Return the columns of numbers on the right of others; none if there are no two of them.

    An oscilloscope may write its settings in the first columns of the first rows.
    """
    filled = [line for line in lines if line.strip()]
    rows = [_cells(line, _separator(filled[0])) for line in filled] if filled else []
    width = min(map(len, rows), default=0)
    found = [i for i in range(width) if all(is_number_cell(row[i]) for row in rows)]
    return found if len(rows) > FEW_LINES and len(found) > 1 else []


def _chosen_columns(lines: Iterable[str], separator: str, columns: Sequence[int]) -> Iterator[str]:
    """Yield lines with some columns only; a line that has not all of them is blank."""
    for line in lines:
        cells = _cells(line, separator)
        is_row = len(cells) > columns[-1]
        yield (separator.join(cells[i] for i in columns) if is_row else "") + "\n"


def _is_content(line: str) -> bool:
    return bool(line.strip()) and not line.startswith(COMMENT)


def _begins_with_a_value(line: str) -> bool:
    cells = _cells(line, _separator(line))
    return is_value_cell(cells[0])


def is_value_cell(cell: str) -> bool:
    """Return whether a cell is a number, a date or a time of day."""
    bare = cell.strip().strip('"')
    return is_number_cell(bare) or DATE.match(bare) is not None


def _is_unit(cell: str) -> bool:
    return is_known_unit(cell.strip(" ()[]"))


def _names_all(cells: Sequence[str]) -> bool:
    names = [cell.strip() for cell in cells]
    return len(set(names)) == len(names) and "" not in names[:-1]


def remove_thousands_separators(rows: list[list[str]]) -> None:
    """Remove the commas of quoted numbers such as ``"1,234.5"``, in place.

    Only a point as well shows that the comma separates thousands: ``"1,234"`` stays as it is,
    unless another cell of its column shows it.
    """
    columns = {
        index
        for row in rows[:HEAD]
        for index, cell in enumerate(row)
        if "," in cell and "." in cell and ENGLISH_THOUSANDS.fullmatch(cell.strip())
    }
    for row in rows if columns else ():
        for index in columns:
            if ENGLISH_THOUSANDS.fullmatch(row[index].strip()):
                row[index] = row[index].replace(",", "")


def write_decimals_with_a_point(rows: list[list[str]], lines: Sequence[int], path: str) -> None:
    """Replace decimal commas in the cells of a table, if it has some.

    Args:
        rows: cells of a table whose separator is not a comma, changed in place.
        lines: line of each row, for error messages.
        path: of the table.

    Raises:
        InputError: a cell has a point as well, as in ``1.234,5``: it may separate thousands.
    """
    if not any(DECIMAL_COMMA.fullmatch(cell.strip()) for row in rows[:HEAD] for cell in row):
        return
    for row, line in zip(rows, lines, strict=True):
        for index, cell in enumerate(row):
            stripped = cell.strip()
            if THOUSANDS.fullmatch(stripped):
                what = f"{stripped!r} has a point, but this table has decimal commas"
                hint = "remove points that separate thousands, or write all decimals with points"
                raise InputError(what, where=f"{path}:{line}", hint=hint)
            if DECIMAL_COMMA.fullmatch(stripped):
                row[index] = stripped.replace(",", ".")


def _separator(line: str) -> str:
    bare = QUOTED.sub("", line)
    found = next((mark for mark in SEPARATORS if mark in bare), None)
    if found is not None:
        return found
    # One name may contain spaces: several columns must at least have a name each.
    return SPACE if len(bare.split()) > 1 else COMMA


def _rows(first: Iterable[str], file: Iterable[str], separator: str) -> Iterator[str]:
    if separator == SPACE:
        # The columns are aligned by any number of spaces.
        return (" ".join(line.split()) + "\n" for line in chain(first, file))
    return chain(first, file)


def _cells(line: str, separator: str) -> list[str]:
    if separator == SPACE:
        return line.split()
    try:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=separator), []) or [""]
    except csv.Error:
        return line.split(separator)


def is_number_cell(cell: str) -> bool:
    """Return whether a cell is a number, with a point or a comma for its decimals."""
    return NUMBER.fullmatch(cell.strip()) is not None
