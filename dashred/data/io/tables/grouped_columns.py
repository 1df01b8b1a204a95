"""Runs side by side: groups of columns, each with the times and the readings of one run."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from dashred.core.errors import InputError
from dashred.data.io.tables.table_layout import (
    TIMES,
    TableLayout,
    split_header,
    unit_of_times,
)

# Labels that can only mean runs, such as "Run #1" or "Trial 2".
RUN = re.compile(r"(run|trial|experiment|episode|data ?set|test)\b.*\d", re.IGNORECASE)
# Labels of columns that may be one quantity in several runs, such as "Subject 1".
REPEATED = re.compile(
    r"(run|trial|experiment|episode|subject|patient|participant|person|animal|rat|mouse|"
    r"replicate|specimen)s?\b.*\d",
    re.IGNORECASE,
)
# Name of their quantity.
READING = "response"
# Both lines of headers in one: "Run 1: Time (s)".
PREFIXED = re.compile(r"(?P<label>[^:]*\d[^:]*):\s*(?P<name>\S.*)")


@dataclass(frozen=True)
class ColumnGroups:
    """Groups of columns with the same headers.

    Attributes:
        labels: of the groups.
        headers: of the columns of each group; a repeated one has a number.
        is_shared: whether the first column has the times of all groups, which have one column each.
    """

    labels: tuple[str, ...]
    headers: tuple[str, ...]
    is_shared: bool = False

    def are_meant(self, layout: TableLayout) -> bool:
        """Return whether the groups are episodes; columns with one clock may be fields as well."""
        return not self.is_shared or layout.headers.get("episode") in self.labels

    @property
    def are_runs(self) -> bool:
        """Whether the labels can only mean runs."""
        return not self.is_shared and all(map(RUN.match, self.labels))

    def check_episodes(self, layout: TableLayout, where: str) -> None:
        """Check that the groups are episodes, by their labels or by the configuration.

        Raises:
            InputError: neither says so.
        """
        if layout.headers.get("episode") in self.labels or self.are_runs:
            return
        problem = f"the columns are in groups, {', '.join(self.labels)}, each with its own times"
        hint = "if each group is an episode, name one of them: "
        hint += f"recording.columns={{episode: {self.labels[0]}}}; else write one table with one "
        raise InputError(problem, where=where, hint=f"{hint}column of times")

    def stacked(
        self, rows: Sequence[Sequence[str]], lines: Sequence[int]
    ) -> tuple[list[list[str]], list[int]]:
        """Return the rows of one group after the other, behind its label, and their lines.

        A row is left out of the groups in which all of its cells are empty.
        """
        found, width = [], len(self.headers)
        for number, label in enumerate(self.labels):
            for row, line in zip(rows, lines, strict=True):
                cells = row[number * width : (number + 1) * width]
                if self.is_shared:
                    cells = [row[0], row[1 + number]]
                if any(cell.strip() for cell in cells[self.is_shared :]):
                    found.append(([label, *cells], line))
        return [row for row, _ in found], [line for _, line in found]


def find_groups(above: Sequence[str], header: Sequence[str]) -> ColumnGroups | None:
    """Return the groups of a header, with the labels in the line above or in front of the names.

    Args:
        above: cells of the line above, empty where the label on their left continues.
        header: cells of the header.

    Returns:
        None if there are no two groups with the same headers, each with one column of times.
    """
    cells = [cell.strip() for cell in header]
    if (repeated := _repeated(cells)) is not None:
        return repeated
    prefixed = [PREFIXED.fullmatch(cell) for cell in cells if cell]
    if all(prefixed) and prefixed:
        labels = [match["label"].strip() for match in prefixed if match]
        cells = [match["name"] for match in prefixed if match]
    else:
        while cells and not cells[-1]:
            cells.pop()
        labels = []
        for cell in above[: len(cells)]:
            labels.append(cell.strip() or (labels[-1] if labels else ""))
    runs = [label for label, _ in groupby(labels)]
    width = len(cells) // len(runs) if runs else 0
    if len(labels) != len(cells) or len(set(runs)) != len(runs) or len(runs) < 2 or "" in runs:
        return None
    if any(label != runs[i // width] for i, label in enumerate(labels[: width * len(runs)])):
        return None
    names = cells[:width]
    # T is a temperature.
    bare = [split_header(name)[0] for name in names]
    times = [name for name in bare if name.lower() in TIMES and name != "T"]
    if cells != names * len(runs) or len(times) != 1 or "" in names:
        return None
    return ColumnGroups(tuple(runs), tuple(_numbered(names)))


def _repeated(cells: Sequence[str]) -> ColumnGroups | None:
    """Return the columns of one quantity in several runs beside one column of times, if it is so.

    They have the names of runs, and the same unit.
    """
    first, *others = [split_header(cell) for cell in cells]
    labels, units = [label for label, _ in others], {unit for _, unit in others}
    is_clock = first[0].lower() in TIMES or unit_of_times(first[0]) is not None
    if not is_clock or len(others) < 2 or len(units) > 1 or not all(map(REPEATED.match, labels)):
        return None
    unit = units.pop()
    named = READING if unit is None else f"{READING} [{unit}]"
    return ColumnGroups(tuple(labels), (cells[0], named), is_shared=True)


def _numbered(headers: Sequence[str]) -> list[str]:
    """Return headers with a number behind the name of each repeated one."""
    found: list[str] = []
    for i, header in enumerate(headers):
        name, before = split_header(header)[0], list(headers[:i]).count(header)
        found.append(header.replace(name, f"{name} {before + 1}", 1) if before else header)
    return found
