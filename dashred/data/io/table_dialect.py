"""How a table of text is written: the lines before its header, its separators and its decimals."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TextIO

from dashred.core.errors import InputError

# Endings of files that are read as tables.
TABLES = (".csv", ".tsv", ".txt", ".dat")
COMMENT = "#"
COMMA, SPACE = ",", " "
# Separators in the order in which they are looked for in the header.
SEPARATORS = ("\t", ";", COMMA)
QUOTED = re.compile(r'"[^"]*"')
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d+)?")
# Rows that are searched for decimal commas.
HEAD = 100


@dataclass(frozen=True)
class TableText:
    """The lines of a table from its header on.

    Attributes:
        lines: the header and the rows.
        separator: between the cells.
        skipped: number of lines before the first of ``lines``.
    """

    lines: Iterator[str]
    separator: str
    skipped: int


def find_header(file: TextIO) -> TableText:
    """Skip blank lines and comments at the beginning of a file, and find the separator.

    A comment directly above a row of numbers is the header, as ``numpy.savetxt`` writes it.
    """
    skipped, comment = 0, ""
    for line in file:
        if line.strip() and not line.startswith(COMMENT):
            break
        skipped += 1
        comment = line.lstrip(COMMENT).strip()
    else:
        return TableText(iter(()), COMMA, skipped)
    separator = _separator(line)
    cells = _cells(line, separator)
    if comment and len(_cells(comment, separator)) == len(cells) and all(map(_is_number, cells)):
        return TableText(_rows([f"{comment}\n", line], file, separator), separator, skipped - 1)
    return TableText(_rows([line], file, separator), separator, skipped)


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
                hint = "does the point separate thousands? Remove it; or write decimals with points"
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


def _rows(first: list[str], file: TextIO, separator: str) -> Iterator[str]:
    if separator == SPACE:
        # The columns are aligned by any number of spaces.
        return (" ".join(line.split()) + "\n" for line in chain(first, file))
    return chain(first, file)


def _cells(line: str, separator: str) -> list[str]:
    return line.split() if separator == SPACE else line.rstrip("\r\n").split(separator)


def _is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell.strip()) is not None
