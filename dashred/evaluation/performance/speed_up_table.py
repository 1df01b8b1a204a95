"""The table of what more workers gain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from dashred.evaluation.benchmark.table import Grid
from dashred.evaluation.performance.digits import three_digits
from dashred.evaluation.performance.rows import Row

# The efficiencies of cases and of one analysis that are aimed at, with so many workers.
GOALS = {"jobs": 0.8, "cluster": 0.8, "columns": 0.6}
GOAL_WORKERS = 4
WAYS = {"jobs": "jobs=", "cluster": "cluster=", "columns": "cluster=, one Jacobian"}
UNITS = {"jobs": "cases", "cluster": "cases", "columns": "columns"}


class SpeedUp(NamedTuple):
    """Seconds of all cases with some workers.

    Attributes:
        row: as measured.
        gain: how much faster than with the fewest workers, times their number.
        efficiency: the gain over the number of workers.
    """

    row: Row
    gain: float
    efficiency: float


def speed_ups(rows: Sequence[Row]) -> Iterator[SpeedUp]:
    """Yield the gain of each number of workers, over the fewest."""
    for part in WAYS:
        measured = [row for row in rows if row["part"] == part]
        for kind in dict.fromkeys(row["kind"] for row in measured):
            same = [row for row in measured if row["kind"] == kind]
            unit = same[0]["size"] * same[0]["seconds"]
            for row in same:
                gain = unit / row["seconds"]
                yield SpeedUp(row, gain, gain / row["size"])


def speed_up_table(rows: Sequence[Row]) -> Grid:
    """Return the seconds and the efficiency of several workers."""
    lines = [
        [
            WAYS[each.row["part"]],
            str(each.row["size"]),
            f"{each.row['cases']} {UNITS[each.row['part']]}, each {each.row['kind']}",
            three_digits(each.row["seconds"]),
            f"{each.gain:.2f}",
            f"{each.efficiency:.2f}",
            three_digits(each.row["start"]) if "start" in each.row else "",
        ]
        for each in speed_ups(rows)
    ]
    header = ("", "workers", "what is divided", "seconds", "speed-up", "efficiency", "start, s")
    return Grid("Workers", header, lines)


def missed_efficiencies(rows: Sequence[Row]) -> list[str]:
    """Return a sentence for each efficiency below the goal."""
    return [
        f"{WAYS[each.row['part']]} with {GOAL_WORKERS} workers: efficiency {each.efficiency:.2f}, "
        f"goal {GOALS[each.row['part']]:g}"
        for each in speed_ups(rows)
        if each.row["size"] == GOAL_WORKERS and each.efficiency < GOALS[each.row["part"]]
    ]
