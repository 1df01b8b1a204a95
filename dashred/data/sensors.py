"""What a sensor is, and whether a system has what it claims to read."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from dashred.core.errors import InputError, nearest
from dashred.core.files.plain_text import unprintable

# Columns of a recording that are not sensors.
RESERVED = ("time", "episode")


@runtime_checkable
class ObservedAxis(Protocol):
    """The part of an axis that a sensor needs: points at ``j·period/around`` of a ring."""

    @property
    def name(self) -> str:
        """The coordinate's name in the equations and in tables of sensors."""

    @property
    def length(self) -> float:
        """Extent of the axis, in its own unit."""

    def inside(self, place: float, /) -> float:
        """Return a place on the axis: around it, or mirrored at an end."""

    @property
    def period(self) -> float:
        """Length of the ring that it is, or half of."""

    @property
    def around(self) -> int:
        """Points of that ring."""


@runtime_checkable
class Described(Protocol):
    """The part of a system that says what can be read in it, and where."""

    @property
    def axes(self) -> tuple[ObservedAxis, ...]:
        """Spatial axes; empty for an ODE system."""

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields, in the order of the state tensor."""

    @property
    def lets(self) -> Collection[str]:
        """Names of the derived quantities."""

    @property
    def inputs(self) -> Mapping[str, str]:
        """The recording's column of every measured input, by its name in the equations."""

    @property
    def units(self) -> Mapping[str, str]:
        """The unit of each name that has one, that of time as ``t``."""

    @property
    def where(self) -> Callable[[str], str]:
        """Tells where a dotted key of the configuration was written."""


@dataclass(frozen=True)
class Sensor:
    """A point sensor.

    Attributes:
        name: its column in a recording.
        reads: the field or let name whose value it gives.
        position: one coordinate per axis, in the axis' unit; empty for an ODE system.
        std: standard deviation of its noise, in the unit of what it reads; None if unknown.
    """

    name: str
    reads: str
    position: tuple[float, ...] = ()
    std: float | None = None


def readable(system: Described) -> tuple[str, ...]:
    """Names that a sensor may read in this system: its fields, then its lets."""
    return (*system.fields, *system.lets)


def check_sensor(sensor: Sensor, system: Described, where: str) -> None:
    """Refuse a sensor that this system cannot have.

    Raises:
        InputError: for an unusable name, an unknown quantity, a position off the axes, or a
            noise level that is not a positive number.
    """
    if unprintable(sensor.name) or sensor.name in ("", *RESERVED):
        problem = f"{sensor.name!r} cannot be a sensor's name"
        raise InputError(problem, where=where, hint="give each sensor a name of its own")
    if sensor.reads not in readable(system):
        problem = f"sensor {sensor.name!r} reads {sensor.reads!r}, which the system does not have"
        raise InputError(problem, where=where, hint=nearest(sensor.reads, readable(system)))
    _check_position(sensor, system, where)
    if sensor.std is not None and not 0 < sensor.std < math.inf:
        problem = f"sensor {sensor.name!r}: std is {sensor.std:g}, but must be positive"
        raise InputError(problem, where=where, hint="leave std empty to have it estimated")


def check_names(names: Iterable[str], where: str) -> None:
    """Refuse names that occur twice.

    Raises:
        InputError: naming the first repeated one.
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise InputError(f"{name!r} occurs twice", where=where, hint="names must be unique")
        seen.add(name)


def _check_position(sensor: Sensor, system: Described, where: str) -> None:
    if len(sensor.position) != len(system.axes):
        axes = ", ".join(axis.name for axis in system.axes) or "no axes"
        problem = f"sensor {sensor.name!r} has {len(sensor.position)} coordinates"
        raise InputError(problem, where=where, hint=f"the system has {axes}")
    for axis, coordinate in zip(system.axes, sensor.position, strict=True):
        if math.isnan(coordinate):
            problem = f"sensor {sensor.name!r} has no place along {axis.name}"
            raise InputError(problem, where=where, hint="write its coordinate")
        if not 0 <= coordinate <= axis.length:
            problem = f"sensor {sensor.name!r} is at {axis.name} = {coordinate:g}, outside the axis"
            hint = f"{axis.name} goes from 0 to {axis.length:g}"
            raise InputError(problem, where=where, hint=hint)
