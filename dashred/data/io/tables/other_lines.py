"""Lines of a file that are not rows of its table: messages of the logger, text below the rows."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from dashred.data.io.tables.table_dialect import is_number_cell, is_value_cell


def drop_other_lines(rows: list[list[str]], lines: array[int]) -> tuple[int, ...]:
    """Remove what is no row of readings, in place, and return its lines.

    The first row begins with a number or a date; otherwise nothing is removed. A line between rows
    without a number and without a date is a message. Below the rows, other tables or remarks begin
    with a blank line or such a message, and no row like the first one follows. A damaged row of
    readings stays, and is an error.

    Args:
        rows: cells of the table, without its header.
        lines: line of each row.
    """
    if not rows or not is_value_cell(rows[0][0]):
        return ()
    width, end = len(rows[0]), len(rows)
    while not _is_like_the_first(rows[end - 1], width):
        end -= 1
    below = range(end, len(rows))
    cut = next((i for i in below if _is_apart(rows[i], lines[i - 1], lines[i])), len(rows))
    others = [i for i in range(cut) if _is_message(rows[i])]
    others += [i for i in range(cut, len(rows)) if _has_content(rows[i])]
    found = tuple(lines[i] for i in others)
    if found:
        dropped = set(others)
        kept = [i for i in range(len(rows)) if i not in dropped]
        rows[:], lines[:] = [rows[i] for i in kept], array("q", [lines[i] for i in kept])
    return found


def _is_like_the_first(row: Sequence[str], width: int) -> bool:
    return len(row) == width and is_value_cell(row[0])


def _is_apart(row: Sequence[str], before: int, line: int) -> bool:
    return line > before + 1 or not any(map(is_number_cell, row))


def _is_message(row: Sequence[str]) -> bool:
    # Most rows begin with a digit.
    if row[0][:1].isdigit() or is_value_cell(row[0]):
        return False
    return _has_content(row) and not any(map(is_value_cell, row))


def _has_content(row: Sequence[str]) -> bool:
    return any(cell.strip() for cell in row)
