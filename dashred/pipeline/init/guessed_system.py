"""What ``init`` guesses of a system, and what the user says of the columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class GuessedAxis:
    """A periodic axis, guessed from the positions of the sensors."""

    name: str
    length: float
    points: int

    @property
    def begin(self) -> float:
        """The beginning of the axis."""
        return 0.0

    def wrap(self, place: float, /) -> float:
        """Return the position unchanged, because all sensors are on the guessed axis."""
        return place

    @property
    def period(self) -> float:
        """The length of the axis."""
        return self.length

    @property
    def ring_points(self) -> int:
        """The number of grid points."""
        return self.points

    @property
    def staggered(self) -> bool:
        """False: the guess is periodic."""
        return False


@dataclass(frozen=True)
class GuessedSystem:
    """System without equations, guessed from a recording.

    Attributes:
        axes: axes that contain the positions of the sensors; empty for an ODE.
        fields: names of the fields that the sensors read.
        lets: columns that are functions of the state.
        inputs: column of each input, by name: that of the column.
        held_inputs: columns of inputs that change in steps.
        left_out: columns of numbers that are no fields: a counter of the rows, a constant.
        of_episodes: columns that are no fields, with one value in each of several episodes.
        empty: columns that are left out, because they are empty in the part that is used.
        units: a unit of time for dates.
        others: lines of the file that are left out, because they are not rows of the table.
        texts: columns that are left out, but may name the sensor of each row.
        row_numbers: column that was taken for the times, but may only count the rows.
    """

    axes: tuple[GuessedAxis, ...]
    fields: tuple[str, ...]
    lets: tuple[str, ...] = ()
    inputs: dict[str, str] = field(default_factory=dict)
    held_inputs: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    of_episodes: tuple[str, ...] = ()
    empty: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    others: tuple[int, ...] = ()
    texts: tuple[str, ...] = ()
    row_numbers: str | None = None

    def contains(self, place: Sequence[float], /) -> bool:
        """True: the axes are the whole domain."""
        return True

    @property
    def where(self) -> Callable[[str], str]:
        """The key itself, because there is no configuration with line numbers."""
        return lambda key: key


@dataclass(frozen=True)
class ChosenColumns:
    """Columns that the user names, as in the file or in the configuration.

    Attributes:
        inputs: columns that drive the system.
        fields: columns that are the fields of an ODE; none for all others.
        ignored: columns that are not read.
    """

    inputs: Sequence[str] = ()
    fields: Sequence[str] = ()
    ignored: Sequence[str] = ()


NONE_CHOSEN = ChosenColumns()
