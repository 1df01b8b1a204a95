"""The sizes of the problem whose pieces are timed."""

from __future__ import annotations

from dataclasses import dataclass

# Intervals between the samples of the shortest record.
INTERVALS = 5
MARCH, COLUMNS, NORMAL_EQUATIONS, SELECTION = (
    "march",
    "columns",
    "normal equations",
    "selection",
)
# In the order in which they need each other.
PIECES = (MARCH, COLUMNS, NORMAL_EQUATIONS, SELECTION)


@dataclass(frozen=True)
class Setting:
    """Sizes of the problem.

    Attributes:
        points: of each of the two axes of the grid.
        sensors: number of sensors of each episode.
        terms: number of terms of the library.
        samples: number of samples of each episode.
        episodes: number of episodes.
        trajectories: number of trajectories that are integrated at once.
    """

    points: int = 32
    sensors: int = 32
    terms: int = 16
    samples: int = 1 + INTERVALS
    episodes: int = 1
    trajectories: int = 8
