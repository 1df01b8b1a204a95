"""Times that a logger rounds so much that some are repeated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# A larger share of rows with the time of the row before may be several readings of one time, and
# fewer rows a mistake.
MOST_REPEATED, FEWEST_REPEATED = 0.4, 5
# Rounding or truncation moves a time by at most this many units of its last digit.
MOVED = 1.001


def without_rounding(
    times: NDArray[np.float64], cells: Sequence[str], episodes: Sequence[slice]
) -> tuple[NDArray[np.float64], bool]:
    """Return the times, on an even clock in episodes that repeat rounded times; and whether any do.

    Args:
        times: of all rows, ``(row,)``.
        cells: the times as they are written.
        episodes: the rows of each episode.
    """
    exact = times
    for rows in episodes:
        even = even_times(times[rows], cells[rows])
        if even is not None:
            exact = times.copy() if exact is times else exact
            exact[rows] = even
    return exact, exact is not times


def even_times(times: NDArray[np.float64], cells: Sequence[str]) -> NDArray[np.float64] | None:
    """Return the times of an even clock that the file has rounded; None if there is no such clock.

    With an even clock every written time is at most one unit of its last digit away from
    ``t_0 + i h``. The step h and t_0 follow from a fit to all rows, weighted by these units.

    Args:
        times: of the rows, never decreasing, with some repetitions, ``(row,)``.
        cells: the times as they are written.
    """
    if not np.isfinite(times).all():
        return None
    steps = np.diff(times)
    repeated = int((steps == 0).sum())
    is_rounded = FEWEST_REPEATED <= repeated <= MOST_REPEATED * len(times)
    if not is_rounded or not (steps >= 0).all():
        return None
    try:
        written = np.array([float(cell) for cell in cells])
    except ValueError:
        return None
    span = float(written[-1] - written[0])
    # The unit of the system may be another one.
    scale = float(times[-1] - times[0]) / span
    digit = scale * np.array([10.0 ** -_decimals(cell) for cell in cells])
    places = np.arange(len(times), dtype=np.float64)
    step, first = np.polyfit(places, times, 1, w=1 / digit)
    even: NDArray[np.float64] = first + step * places
    is_even = bool((np.abs(times - even) <= MOVED * digit).all()) and step > 0
    return even if is_even else None


def _decimals(cell: str) -> int:
    """Return the number of decimal digits of a number as it is written; negative for 3e2."""
    mantissa, _, exponent = cell.strip().lower().partition("e")
    return len(mantissa.partition(".")[2]) - int(exponent or 0)
