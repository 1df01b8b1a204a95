"""Reading of recordings as loggers write them: lines about the header, groups, empty ends."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import replace

from dashred.core.errors import InputError
from dashred.core.unit_conversion import is_known_unit
from dashred.data.io.tables.csv_table import Table, check_rectangular, read_cells, table_of
from dashred.data.io.tables.grouped_columns import ColumnGroups
from dashred.data.io.tables.other_lines import drop_other_lines
from dashred.data.io.tables.table_dialect import TableText, find_recording
from dashred.data.io.tables.table_header import example_names, number_repeated, read_header
from dashred.data.io.tables.table_layout import TIMES, TableLayout

# Rows that show how many columns a table has.
HEAD_ROWS = 100


def read_recording_table(path: str, layout: TableLayout) -> Table:
    """Read the table of a recording as a logger writes it.

    Beyond what :func:`read_table` reads, other lines may precede the header, a line with units may
    follow it, a separator may end each line, messages and remarks may stand between and below the
    rows, the configuration may name the columns, and headers may be repeated where nothing uses
    them, or where the columns are equal.

    Raises:
        InputError: as :func:`dashred.data.io.tables.csv_table.read_table`, or there are no names.
    """
    text, rows, lines = read_cells(path, find_recording)
    groups, named = text.groups, len(layout.every_name or ())
    if groups is not None and groups.are_meant(layout) and named != len(rows[0]):
        return _grouped_table(path, layout, text, groups, rows, lines)
    header, names, below = lines[0], layout.every_name, text.below_header
    units_row = [cell.strip(" ()[]") for cell in rows[1]] if below else []
    if names is None:
        if not text.has_header and not layout.headers:
            hint = f"give them: recording.columns=[{', '.join(example_names(len(rows[0])))}]"
            raise InputError("the columns have no names", where=f"{path}:{header}", hint=hint)
        numbers = [str(number + 1) for number in range(len(rows[0]))]
        headers = rows[0] if text.has_header else numbers
    else:
        headers = list(names)
    if text.has_header:
        # In place: copying the list of a long table would double its memory.
        del rows[: 1 + below], lines[: 1 + below]
    others = drop_other_lines(rows, lines)
    _drop_empty_rows(rows, lines)
    if names is None:
        _fill_ends(headers, rows)
    _drop_empty_end(headers, rows)
    repeated: dict[str, str] = {}
    if names is None:
        headers, repeated = number_repeated(headers)
        headers = layout.rename(headers, f"{path}:{header}")
    columns, units = read_header(headers, f"{path}:{header}", layout.used)
    for column, unit in zip(columns, units_row, strict=False):
        if is_known_unit(unit):
            units.setdefault(column, unit)
    table = table_of(path, columns, units, text, rows, lines, header)
    return replace(_without_copies(table, repeated, layout), others=others)


def count_unnamed(path: str) -> int:
    """Return the number of columns of a recording without a header; 0 if it has one.

    Raises:
        InputError: as :func:`dashred.data.io.tables.csv_table.read_table`.
    """
    text, rows, _ = read_cells(path, find_recording, HEAD_ROWS)
    if text.has_header:
        return 0
    return len(rows[0]) - all(not row[-1].strip() for row in rows)


def unclear_groups(path: str) -> tuple[str, ...]:
    """Return the labels of groups of columns that may be episodes; none if they clearly are.

    Raises:
        InputError: as :func:`dashred.data.io.tables.csv_table.read_table`.
    """
    groups = read_cells(path, find_recording, HEAD_ROWS)[0].groups
    return () if groups is None or groups.are_runs else groups.labels


def _grouped_table(
    path: str,
    layout: TableLayout,
    text: TableText,
    groups: ColumnGroups,
    rows: list[list[str]],
    lines: array[int],
) -> Table:
    """Return the groups of a table as episodes, one below the other."""
    where, names = f"{path}:{lines[0]}", layout.every_name
    groups.check_episodes(layout, where)
    own = {name: header for name, header in layout.headers.items() if name != "episode"}
    headers = replace(layout, headers=own).rename(groups.headers, where) if names is None else names
    columns, units = read_header(["episode", *headers], where, layout.used)
    begin = 1 + text.below_header
    check_rectangular(path, rows[0], rows[begin:], lines[begin:])
    stacked, own_lines = groups.stacked(rows[begin:], lines[begin:])
    return table_of(path, columns, units, text, stacked, array("q", own_lines), lines[0])


def _drop_empty_rows(rows: list[list[str]], lines: array[int]) -> None:
    """Remove the rows in which all cells are empty, as a logger may write them at the end."""
    kept = [at for at, row in enumerate(rows) if any(cell.strip() for cell in row)]
    if len(kept) < len(rows):
        rows[:] = [rows[at] for at in kept]
        lines[:] = array("q", [lines[at] for at in kept])


def _without_copies(table: Table, repeated: Mapping[str, str], layout: TableLayout) -> Table:
    """Return a table without the columns that repeat both the header and the values of another one.

    Args:
        table: the recording.
        repeated: the repeated header of every numbered column.
        layout: what is used, and what is left out.

    Raises:
        InputError: of two columns with the same header and other values one is used, and neither
            is left out.
    """
    renamed = {header: own for own, header in layout.headers.items()}
    copies = []
    for column, header in repeated.items():
        name = renamed.get(header, header)
        if not {name, column} <= set(table.columns) or {name, column} & {*layout.ignored}:
            continue
        has_same_unit = table.units.get(name) == table.units.get(column)
        if has_same_unit and table.texts(name) == table.texts(column):
            copies.append(column)
        elif name in layout.used or name.lower() in (*TIMES, "episode"):
            hint = f"leave one of them out: recording.ignore=['{column}']"
            where = table.header_location(name)
            raise InputError(f"{name!r} occurs twice, with other values", where=where, hint=hint)
    return table.without(copies) if copies else table


def _fill_ends(headers: list[str], rows: list[list[str]]) -> None:
    """Add empty cells at the end of rows, if the logger leaves them off from the first row on."""
    if not rows or len(rows[0]) >= len(headers):
        return
    for row in rows:
        row.extend([""] * (len(headers) - len(row)))


def _drop_empty_end(headers: list[str], rows: list[list[str]]) -> None:
    """Remove the cell after the last separator of each line, if all lines end with a separator."""
    width = len(rows[0]) if rows else 0
    if not rows or any(len(row) != width or row[-1].strip() for row in rows):
        return
    if len(headers) == width and not headers[-1]:
        headers.pop()
    if len(headers) == width - 1:
        for row in rows:
            row.pop()
