"""Tables of the rates of the machine, and of how far the engine is from them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from dashred.core.work import COLUMN_STEPS, TRAJECTORY_STEPS
from dashred.evaluation.benchmark.table import Grid
from dashred.evaluation.performance.digits import three_digits
from dashred.evaluation.performance.measured.setting import COLUMNS, MARCH
from dashred.evaluation.performance.rows import Row

# Measured seconds over the floor that are aimed at.
GOAL = 5.0
COUNTED = {MARCH: TRAJECTORY_STEPS, COLUMNS: COLUMN_STEPS}


class Distance(NamedTuple):
    """Seconds of a step beside its floor.

    Attributes:
        grid: points of each axis.
        piece: march or columns.
        seconds: of one step of one trajectory or column.
        floor: the least seconds, at the rates of the machine.
        operations: floating-point operations of the step.
        bytes: read and written outside of the transforms.
    """

    grid: int
    piece: str
    seconds: float
    floor: float
    operations: float
    bytes: float

    @property
    def ratio(self) -> float:
        """Measured seconds over the floor."""
        return self.seconds / self.floor


def distances(rows: Sequence[Row]) -> Iterator[Distance]:
    """Yield the distances from the floor, by grid."""
    for row in rows:
        if "floor" not in row:
            continue
        for piece, kind in COUNTED.items():
            measured, floor = row["pieces"][piece], row["floor"][piece]
            seconds = measured["seconds"] / measured["work"][kind]
            yield Distance(
                row["size"],
                piece,
                seconds,
                floor["seconds"],
                floor["operations"],
                floor["bytes"],
            )


def floor_table(rows: Sequence[Row]) -> Grid:
    """Return the measured seconds of a step beside the floor."""
    lines = [
        [
            f"{each.grid}²",
            each.piece,
            three_digits(each.operations / 1e6),
            three_digits(each.bytes / 1e6),
            three_digits(1e6 * each.floor),
            three_digits(1e6 * each.seconds),
            f"{each.ratio:.1f}",
        ]
        for each in distances(rows)
    ]
    header = ("grid", "a step of", "10⁶ operations", "MB", "floor, µs", "measured, µs", "ratio")
    return Grid("Distance from the limit", header, lines)


def rates_table(rows: Sequence[Row]) -> Grid:
    """Return the measured rates of the machine."""
    lines = []
    for row in rows:
        if "floor" not in row:
            continue
        rates, points = row["floor"]["rates"], int(row["size"]) ** 2
        operations = 2.5 * points * math.log2(points)
        transforms = rates["transform64"], rates["transform32"]
        lines.append(
            [
                f"{row['size']}²",
                *(three_digits(1e6 * seconds) for seconds in transforms),
                *(three_digits(operations / seconds / 1e9) for seconds in transforms),
                three_digits(rates["bandwidth"] / 1e9),
                three_digits(rates["arithmetic"] / 1e9),
            ]
        )
    header = (
        "grid",
        "transform, float64, µs",
        "float32, µs",
        "float64, GFLOP/s",
        "float32, GFLOP/s",
        "bandwidth, GB/s",
        "product of matrices, GFLOP/s",
    )
    return Grid("Rates", header, lines)


def missed_floors(rows: Sequence[Row]) -> list[str]:
    """Return a sentence for each step that takes longer than the goal."""
    return [
        f"{each.piece} on {each.grid}²: {each.ratio:.1f} times the floor, goal {GOAL:g}"
        for each in distances(rows)
        if each.ratio > GOAL
    ]
