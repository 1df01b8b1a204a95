"""Words for a missing value in the cells of a table, such as NA or null."""

from __future__ import annotations

MISSING = frozenset({"na", "n/a", "#n/a", "<na>", "nan", "null", "none", "-", "--", "."})


def blank_missing(rows: list[list[str]]) -> None:
    """Empty the cells with a word for a missing value in columns of numbers, in place.

    In a column of texts such a word may be a name: NA is sodium.

    Args:
        rows: cells of a table, all rows of equal length.
    """
    for index in range(len(rows[0]) if rows else 0):
        cells = {row[index] for row in rows}
        words = {cell for cell in cells if cell.strip().lower() in MISSING}
        if not words or not _has_numbers_only(cells - words):
            continue
        for row in rows:
            if row[index] in words:
                row[index] = ""


def _has_numbers_only(cells: set[str]) -> bool:
    """Return whether there is a number, and no cell is a text."""
    known = [cell for cell in cells if cell.strip()]
    try:
        return bool([float(cell) for cell in known])
    except ValueError:
        return False
