"""Values that have the right type but make no sense, or do not fit each other."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import is_dataclass
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from dashred.config.checks.snapshot_checks import check_snapshots
from dashred.config.checks.system_checks import check_system
from dashred.config.schema.recording import Recording, SensorSplit
from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where, required
from dashred.core.errors import InputError, nearest
from dashred.core.limits import Limit

TWIN = re.compile(r"[A-Za-z0-9_-]+\Z")
DEVICE = re.compile(r"(cpu|cuda(:\d{1,3})?)\Z")
MOST_POINTS, MOST_STEPS = 1_000_000, 10_000_000


def check(settings: Settings, where: Where) -> None:
    """Refuse impossible values.

    Raises:
        InputError: which key, where it was written, and what it may be.
    """
    check_limits(settings, Settings, "", where)
    check_snapshots(settings, where)
    check_system(settings.system, where)
    _check_effort(settings, where)
    _check_library(settings, where)
    _check_recording(settings, where)
    _check_sensor_split(settings.splits.sensors, settings.recording, where)
    if settings.simulation.held_out >= settings.simulation.members:
        raise InputError(
            "simulation.held_out leaves no member to train on",
            where=where("simulation.held_out"),
            hint=f"it must be below simulation.members, {settings.simulation.members}",
        )
    if not DEVICE.match(settings.device):
        raise InputError(
            f"unknown device {settings.device!r}", where=where("device"), hint="cpu, cuda or cuda:1"
        )


def check_limits(value: Any, kind: Any, key: str, where: Where) -> None:
    """Hold every number of a tree against the limit that its type carries.

    Raises:
        InputError: a number that is not finite or not within its limit.
    """
    if value is None or kind is Any:
        return
    bare, limit = _unwrapped(kind)
    if isinstance(value, dict):
        for name, item in value.items():
            check_limits(item, get_args(bare)[1], f"{key}.{name}", where)
    elif isinstance(value, list):
        for i, item in enumerate(value):
            check_limits(item, get_args(bare)[0], f"{key}[{i}]", where)
    elif is_dataclass(value):
        for name, member in get_type_hints(bare, include_extras=True).items():
            check_limits(getattr(value, name), member, f"{key}.{name}".lstrip("."), where)
    elif isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{key} must be finite; got {value}", where=where(key))
    elif limit and not limit.holds(value):
        raise InputError(f"{key} must be {limit}; got {value:g}", where=where(key))


def _unwrapped(kind: Any) -> tuple[Any, Limit | None]:
    """A kind without ``| None``, and the limit that it carries."""
    kind = required(kind)
    if get_origin(kind) is Annotated:
        bare, *carried = get_args(kind)
        return bare, next((mark for mark in carried if isinstance(mark, Limit)), None)
    return kind, None


def _check_effort(settings: Settings, where: Where) -> None:
    """Refuse what no machine would ever finish: a slip of the finger, or of a unit."""
    system, recording = settings.system, settings.recording
    points = math.prod(axis.points for axis in system.axes.values())
    if points > MOST_POINTS:
        hint = f"{MOST_POINTS} at most"
        raise InputError(
            f"{points} grid points are too many", where=where("system.axes"), hint=hint
        )
    dt, spin_up_dt = system.integrator.dt, system.spin_up_dt
    spin_up_key = "system.spin_up_dt" if spin_up_dt else "system.integrator.dt"
    steps = [(spin_up_key, system.spin_up, spin_up_dt or dt)]
    if recording.twin is not None:
        steps += [("system.integrator.dt", recording.duration, dt)]
        steps += [("recording.every", recording.duration, recording.every or recording.duration)]
    for key, span, step in steps:
        # Snapshots have no step of their own: they are not stepped.
        if step is not None and span > MOST_STEPS * step:
            problem = f"{key}: {span:g} in steps of {step:g} are too many steps"
            raise InputError(problem, where=where(key), hint=f"{MOST_STEPS} at most")


def _check_library(settings: Settings, where: Where) -> None:
    equations = settings.system.fields
    for name, terms in (settings.library or {}).items():
        key = f"library.{name}"
        if name not in equations:
            raise InputError(
                f"library names an equation {name} that the system does not have",
                where=where(key),
                hint=nearest(name, equations),
            )
        if twice := _repeated(terms):
            raise InputError(f"{key} holds {twice!r} twice", where=where(key))
    for key, numbers in {
        "shred.decoder": settings.shred.decoder,
        "latent_sindy.steps": settings.latent_sindy.steps,
    }.items():
        if not numbers:
            raise InputError(f"{key} is empty", where=where(key))


def _check_recording(settings: Settings, where: Where) -> None:
    recording, system = settings.recording, settings.system
    _check_sensors(recording, where)
    for i, name in enumerate(recording.reads):
        if name not in system.fields and name not in system.let:
            raise InputError(
                f"recording.reads names {name}, which is no field and no let",
                where=where(f"recording.reads[{i}]"),
                hint=nearest(name, [*system.fields, *system.let]),
            )
    if recording.twin is not None:
        _check_twin(recording, where)


def check_recorded(settings: Settings, where: Where) -> None:
    """Refuse a configuration that names nothing to analyse.

    Raises:
        InputError: neither a twin nor a recording.
    """
    if settings.recording.twin is None and settings.recording.path is None:
        raise InputError(
            "there is nothing to analyse: no recording",
            where=where("recording"),
            hint="give recording.path=FILE, or recording.twin=NAME",
        )


def _check_sensors(recording: Recording, where: Where) -> None:
    count = recording.sensors
    if isinstance(count, str) or (type(count) is int and count >= 1):
        return
    raise InputError(
        f"recording.sensors must be a number from 1 up, or the path of a table; got {count!r}",
        where=where("recording.sensors"),
    )


def _check_twin(recording: Recording, where: Where) -> None:
    if not TWIN.match(recording.twin or ""):
        raise InputError(
            f"{recording.twin!r} is not the name of a twin",
            where=where("recording.twin"),
            hint="recording.twin=a, for example; a file of yours is recording.path=FILE",
        )
    if recording.every is None or recording.every >= recording.duration:
        raise InputError(
            "a twin needs recording.every, the step between its samples, below recording.duration",
            where=where("recording.every"),
        )


def _check_sensor_split(split: SensorSplit, recording: Recording, where: Where) -> None:
    named: list[str] = []
    for role, value in (("validate", split.validate), ("test", split.test)):
        names = value if isinstance(value, list) else []
        number = type(value) is int and value >= 0
        if not number and not (isinstance(value, list) and all(isinstance(x, str) for x in names)):
            raise InputError(
                f"splits.sensors.{role} must be a number from 0 up, or a list of sensor names",
                where=where(f"splits.sensors.{role}"),
            )
        named += names
        if twice := _repeated(named):
            raise InputError(
                f"sensor {twice!r} is held out twice",
                where=where(f"splits.sensors.{role}"),
                hint="a sensor validates or tests, not both",
            )
    fitted = recording.sensors if recording.twin and isinstance(recording.sensors, int) else None
    if fitted is not None and split.extra is not None and split.extra >= fitted:
        raise InputError(
            "splits.sensors.extra leaves no sensor for SHRED's input",
            where=where("splits.sensors.extra"),
            hint=f"it must be below recording.sensors, {fitted}",
        )


def _repeated(items: list[str]) -> str | None:
    counts = Counter(items)
    return next((item for item in items if counts[item] > 1), None)
