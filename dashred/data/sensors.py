"""Point sensors, and checks that a system can have them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product, zip_longest
from typing import Protocol, runtime_checkable

from dashred.core.errors import InputError, nearest
from dashred.core.files.plain_text import first_unprintable
from dashred.core.stated.noise import NoiseLaw

# Columns of a recording that are not sensors.
RESERVED = ("time", "episode")


@runtime_checkable
class ObservedAxis(Protocol):
    """The part of an axis that a sensor needs: a ring with points at ``j·period/ring_points``."""

    @property
    def name(self) -> str:
        """Name of the coordinate in the equations and in the table of sensors."""

    @property
    def length(self) -> float:
        """Extent of the axis, in its own unit."""

    @property
    def begin(self) -> float:
        """The smallest coordinate."""

    def wrap(self, place: float, /) -> float:
        """Map a coordinate onto the axis: wrapped if periodic, else mirrored at an end."""

    @property
    def period(self) -> float:
        """Length of the ring: the axis itself if periodic, else twice its length."""

    @property
    def points(self) -> int:
        """Number of grid steps, or of cells."""

    @property
    def ring_points(self) -> int:
        """Number of points on the ring."""

    @property
    def staggered(self) -> bool:
        """Whether the points are cells and faces."""


@runtime_checkable
class SystemDescription(Protocol):
    """The part of a system that describes what sensors can read, and where."""

    @property
    def axes(self) -> tuple[ObservedAxis, ...]:
        """Spatial axes; empty for an ODE system."""

    def contains(self, place: Sequence[float], /) -> bool:
        """Return whether a place, whose coordinates are on the axes, is in the domain."""

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields, in the order of the state tensor."""

    @property
    def lets(self) -> Collection[str]:
        """Names of the derived quantities."""

    @property
    def inputs(self) -> Mapping[str, str]:
        """Column of each measured input in the recording, by its name in the equations."""

    @property
    def held_inputs(self) -> Collection[str]:
        """Columns of the inputs whose samples hold until the next one."""

    @property
    def units(self) -> Mapping[str, str]:
        """Units by name in the equations, where stated; the unit of time is under ``t``."""

    @property
    def where(self) -> Callable[[str], str]:
        """Return the location in the configuration of a dotted key."""


@dataclass(frozen=True)
class Sensor:
    """A sensor at a point, or one that averages over a region about it.

    Attributes:
        name: its column in a recording.
        reads: the field or derived quantity that it measures.
        position: one coordinate per axis, in the axis' unit; empty for an ODE system.
        std: noise std, in the unit of the measured quantity; None if unknown.
        std_share: noise std as a share of the std of its readings; None if it is not stated so.
        noise_law: noise std as a function of the reading; None if it is constant. ``std`` is its
            rms over the readings, once they are known.
        known: let with the part of its readings that inputs and time determine, and that has been
            subtracted from them; empty without one.
        factor: let with the function of inputs and time by which its readings have been divided,
            over its typical size; empty without one.
        is_calibrated: whether its gain or offset is fitted. Such a sensor is not held out.
        has_stops: whether it saturates (:mod:`dashred.data.stated.saturation`).
        widths: widths of the region along each axis, in the axis' unit; empty for a point.
    """

    name: str
    reads: str
    position: tuple[float, ...] = ()
    std: float | None = None
    std_share: float | None = None
    noise_law: NoiseLaw | None = None
    known: str = ""
    factor: str = ""
    is_calibrated: bool = False
    has_stops: bool = False
    widths: tuple[float, ...] = ()

    @property
    def quantities(self) -> tuple[str, ...]:
        """The field or lets whose sum was measured."""
        return (self.reads, self.known) if self.known else (self.reads,)


def observable_names(system: SystemDescription) -> tuple[str, ...]:
    """Return the names that a sensor of this system may read: fields, then derived quantities."""
    return (*system.fields, *system.lets)


def check_named_sensors(
    sensors: Sequence[Sensor], names: Iterable[str], key: str, where: str
) -> None:
    """Check that every name is that of a sensor or of what one reads.

    Args:
        sensors: of the recording.
        names: what a configuration key names.
        key: this key, for error messages.
        where: its location.

    Raises:
        InputError: one is neither.
    """
    known = [name for sensor in sensors for name in (sensor.name, sensor.reads)]
    for name in names:
        if name not in known:
            problem = f"{key} names {name!r}, but no sensor has or reads this name"
            raise InputError(problem, where=where, hint=nearest(str(name), known))


def check_sensor(sensor: Sensor, system: SystemDescription, where: str) -> None:
    """Check that a sensor fits a system.

    Raises:
        InputError: for an unusable name, an unknown quantity, a position outside the axes, or a
            noise std that is not a positive number.
    """
    if first_unprintable(sensor.name) or sensor.name in ("", *RESERVED):
        problem = f"{sensor.name!r} is not a valid sensor name"
        raise InputError(problem, where=where, hint="give each sensor a unique name")
    if sensor.reads not in observable_names(system):
        problem = f"sensor {sensor.name!r} reads {sensor.reads!r}, which the system does not have"
        raise InputError(problem, where=where, hint=nearest(sensor.reads, observable_names(system)))
    _check_position(sensor, system, where)
    if sensor.std is not None and not 0 < sensor.std < math.inf:
        problem = f"sensor {sensor.name!r}: std is {sensor.std:g}, but must be positive"
        raise InputError(problem, where=where, hint="leave std empty to have it estimated")


def check_names(names: Iterable[str], where: str) -> None:
    """Check that names are unique.

    Raises:
        InputError: for the first repeated name.
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise InputError(f"{name!r} occurs twice", where=where, hint="names must be unique")
        seen.add(name)


def _check_position(sensor: Sensor, system: SystemDescription, where: str) -> None:
    if len(sensor.position) != len(system.axes):
        axes = ", ".join(axis.name for axis in system.axes) or "no axes"
        problem = f"sensor {sensor.name!r} has {len(sensor.position)} coordinates"
        raise InputError(problem, where=where, hint=f"the system has {axes}")
    for axis, coordinate in zip(system.axes, sensor.position, strict=True):
        if math.isnan(coordinate):
            problem = f"sensor {sensor.name!r} has no {axis.name} coordinate"
            raise InputError(problem, where=where, hint="give its coordinate")
        if not axis.begin <= coordinate <= axis.begin + axis.length:
            problem = f"sensor {sensor.name!r} is at {axis.name} = {coordinate:g}, outside the axis"
            hint = f"{axis.name} goes from {axis.begin:g} to {axis.begin + axis.length:g}"
            raise InputError(problem, where=where, hint=hint)
    for axis, coordinate, width in zip(system.axes, sensor.position, sensor.widths, strict=False):
        _check_width(sensor, axis, coordinate, width, where)
    for place in _corners(sensor):
        if not system.contains(place):
            at = ", ".join(f"{x:g}" for x in place)
            problem = f"sensor {sensor.name!r} reads at ({at}), outside the mesh"
            hint = "its place must be in the convex hull of the nodes"
            raise InputError(problem, where=where, hint=hint)


def _corners(sensor: Sensor) -> list[tuple[float, ...]]:
    """Return the corners of the region of a sensor; of a point, the point itself."""
    sides = [
        (place - width / 2, place + width / 2) if width else (place,)
        for place, width in zip_longest(sensor.position, sensor.widths, fillvalue=0.0)
    ]
    return list(product(*sides))


def _check_width(
    sensor: Sensor, axis: ObservedAxis, coordinate: float, width: float, where: str
) -> None:
    column = f"{axis.name}_width"
    if not 0 <= width <= axis.length:
        problem = f"sensor {sensor.name!r}: {column} is {width:g}"
        hint = f"it must be at least 0 and at most the length of the axis, {axis.length:g}"
        raise InputError(problem, where=where, hint=hint)
    is_ring = axis.period == axis.length
    low, high = axis.begin, axis.begin + axis.length
    if not is_ring and not low + width / 2 <= coordinate <= high - width / 2:
        problem = f"sensor {sensor.name!r} averages beyond an end of the axis {axis.name}"
        hint = f"{axis.name} goes from {low:g} to {high:g}: reduce {column}, or move the sensor"
        raise InputError(problem, where=where, hint=hint)
