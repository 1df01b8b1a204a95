"""A localised source as it is reported: where it acts, how strong it is, and its period."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LocatedSource:
    """A source in one equation, in the user's units.

    Attributes:
        equation: field whose equation has the source.
        axes: names of the axes.
        place: of its peak, one coordinate for each axis.
        place_std: standard deviation of each coordinate.
        region: from where to where it acts along each axis; it may wrap around a ring.
        period: its period; None if it is not periodic.
        period_std: standard deviation of the period.
        begin: time at which it begins; None if it acts from the start.
        begin_std: standard deviation of this time.
        strength: its integral over the domain, averaged over the record.
        strength_std: standard deviation of the strength.
        share: share of the misfit beyond noise that it explains.
        times: times of the rates.
        rates: its integral over the domain at these times.
    """

    equation: str
    axes: tuple[str, ...]
    place: tuple[float, ...]
    place_std: tuple[float, ...]
    region: tuple[tuple[float, float], ...]
    period: float | None
    period_std: float | None
    begin: float | None
    begin_std: float | None
    strength: float
    strength_std: float
    share: float
    times: tuple[float, ...]
    rates: tuple[float, ...]

    @property
    def parts(self) -> frozenset[str]:
        """Its parts, as those of a law: a constant, in a box along every axis, at some times."""
        boxes = (f"in a box of {axis}" for axis in self.axes)
        courses = {"a period": self.period, "an onset of t": self.begin}
        at_times = (name for name, value in courses.items() if value is not None)
        return frozenset([f"{self.equation}: 1", *boxes, *at_times])
