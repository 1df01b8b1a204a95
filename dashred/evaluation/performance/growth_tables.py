"""Tables of how seconds and memory grow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dashred.evaluation.benchmark.table import Grid
from dashred.evaluation.performance.digits import three_digits
from dashred.evaluation.performance.fit import Exponent, fit_exponent, fit_line
from dashred.evaluation.performance.measured.setting import COLUMNS, PIECES
from dashred.evaluation.performance.plan import GROWTHS
from dashred.evaluation.performance.rows import Row

# The largest exponents that are aimed at; with the library, the columns are apart.
GOALS = {"grid": 1.1, "library": 0.3, "record": 1.1}
APART = {"library": {COLUMNS}}


def growth_tables(rows: Sequence[Row]) -> list[Grid]:
    """Return a table of seconds and memory for each quantity that grows."""
    tables = []
    for part, growth in GROWTHS.items():
        measured = _of(rows, part)
        if measured:
            header = [_size_name(part), *(f"{name}, s" for name in growth.pieces), "memory, MiB"]
            lines = [
                [
                    _size(part, row),
                    *(three_digits(row["pieces"][name]["seconds"]) for name in growth.pieces),
                    f"{row['memory']:.0f}",
                ]
                for row in measured
            ]
            tables.append(Grid(growth.title, header, lines))
    return tables


def exponents_table(rows: Sequence[Row]) -> Grid:
    """Return the fitted exponents of seconds, and the lines of memory."""
    lines = []
    for part, growth in GROWTHS.items():
        exponents = _exponents(rows, part)
        if exponents:
            lines.append(
                [
                    growth.title,
                    *(_interval(exponents.get(name)) for name in PIECES),
                    _goal(part),
                    _memory(_of(rows, part)),
                ]
            )
    return Grid("Exponents", ["", *PIECES, "goal", "peak memory, MiB"], lines)


def missed_goals(rows: Sequence[Row]) -> list[str]:
    """Return a sentence for each exponent above its goal."""
    return [
        f"{name} over {GROWTHS[part].title}: exponent {found.value:.2f}, goal {goal:g}"
        for part, goal in GOALS.items()
        for name, found in _exponents(rows, part).items()
        if name not in APART.get(part, set()) and found.value > goal
    ]


def _exponents(rows: Sequence[Row], part: str) -> Mapping[str, Exponent]:
    """Return the exponents of the pieces of one quantity, where there are enough sizes."""
    measured = _of(rows, part)
    sizes = [row["amount"] for row in measured]
    found = {
        name: fit_exponent(sizes, [row["pieces"][name]["seconds"] for row in measured])
        for name in GROWTHS[part].pieces
    }
    return {name: exponent for name, exponent in found.items() if exponent is not None}


def _of(rows: Sequence[Row], part: str) -> list[Row]:
    return [row for row in rows if row["part"] == part]


def _size_name(part: str) -> str:
    return "grid" if part == "grid" else GROWTHS[part].title


def _size(part: str, row: Row) -> str:
    return f"{row['size']}²" if part == "grid" else str(row["amount"])


def _interval(exponent: Exponent | None) -> str:
    if exponent is None:
        return ""
    width = "" if exponent.half_width is None else f" ± {exponent.half_width:.2f}"
    # Adding 0.0 converts -0.0 to 0.0.
    return f"{round(exponent.value, 2) + 0.0:.2f}{width}"


def _goal(part: str) -> str:
    if part not in GOALS:
        return ""
    apart = "".join(f", {name} apart" for name in APART.get(part, ()))
    return f"≤ {GOALS[part]:g}{apart}"


def _memory(rows: Sequence[Row]) -> str:
    line = fit_line([row["amount"] for row in rows], [row["memory"] for row in rows])
    if line is None:
        return ""
    return f"{line.constant:.0f} + {three_digits(line.slope)} n (within {100 * line.misfit:.0f} %)"
