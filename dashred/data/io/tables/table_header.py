"""The header of a table: names of the columns, and their units."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from itertools import count

from dashred.core.errors import InputError
from dashred.core.units import check_unit
from dashred.data.io.tables.table_layout import NUMBER, split_header
from dashred.data.sensors import check_names

# Names that an error message lists.
FEW = 6


def read_header(
    cells: list[str], where: str, used: Collection[str] = ()
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the names of the columns, and the units of those that have one.

    Args:
        cells: the headers.
        where: location of the header.
        used: headers that are names as they stand.

    Raises:
        InputError: a column has no name, or one that was used before, or an empty unit.
    """
    headers = _split_units(cells, used)
    columns = tuple(name for name, _ in headers)
    if "" in columns:
        problem = f"column {columns.index('') + 1} has no name"
        raise InputError(problem, where=where, hint="the first line must name every column")
    check_names(columns, where)
    return columns, {
        name: check_unit(unit, f"column {name!r}", where)
        for name, unit in headers
        if unit is not None
    }


def _split_units(cells: list[str], used: Collection[str]) -> list[tuple[str, str | None]]:
    """Separate names and units; the numbers in ``u[0],u[1]`` belong to the names.

    ``u [1]`` is dimensionless, unless another column is named u with a number in brackets. Headers
    that would have the same name without their units in ( ) or after a comma keep them.
    """
    headers = [split_header(cell) for cell in cells]
    numbered = Counter(name for name, unit in headers if unit and NUMBER.fullmatch(unit))
    repeated = Counter(name for name, _ in headers)
    return [
        (cell.strip(), None)
        if cell.strip() in used
        or (unit and NUMBER.fullmatch(unit) and (unit != "1" or numbered[name] > 1))
        or (not cell.endswith("]") and repeated[name] > 1)
        else (name, unit)
        for cell, (name, unit) in zip(cells, headers, strict=True)
    ]


def number_repeated(cells: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Number the headers that repeat another one: ``Loop (2)``, and ``u (2) [V]`` with a unit.

    A column without a header is called by its number, ``column 1``: many programs write the number
    of each row first.

    Returns:
        The headers; and the repeated name of every numbered one, without units.
    """
    found: list[str] = []
    repeated: dict[str, str] = {}
    names: set[str] = set()
    for place, cell in enumerate(map(str.strip, cells)):
        header = cell or f"column {place + 1}"
        name, unit = split_header(header)
        if unit is None or not header.endswith("]") or NUMBER.fullmatch(unit):
            name, unit = header, None
        if name in names:
            others = (f"{name} ({number})" for number in count(2))
            free = next(n for n in others if n not in names and n not in cells)
            repeated[free], name = name, free
            header = free if unit is None else f"{free} [{unit}]"
        names.add(name)
        found.append(header)
    return found, repeated


def example_names(count: int) -> list[str]:
    """Return examples of names for so many columns."""
    names = ["time", *(f"u{i}" for i in range(1, count))]
    return names if count <= FEW else [*names[:FEW], "..."]
