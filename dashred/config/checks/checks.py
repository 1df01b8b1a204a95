"""Checks for values that have the right type but are impossible or inconsistent."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import is_dataclass
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from dashred.config.checks.cluster_checks import check_cluster
from dashred.config.checks.simulator_checks import check_simulator
from dashred.config.checks.snapshot_checks import check_snapshots
from dashred.config.checks.system_checks import check_system
from dashred.config.checks.tracking_checks import check_tracking
from dashred.config.checks.trainer_checks import check_trainer
from dashred.config.schema.recording import Recording, SensorSplit
from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where, required
from dashred.core.errors import InputError, nearest
from dashred.core.limits import Limit
from dashred.core.stated.average import parse_average
from dashred.core.stated.calibration import parse_calibration
from dashred.core.stated.column_names import parse_columns
from dashred.core.stated.memory import parse_memory
from dashred.core.stated.noise import parse_noise
from dashred.core.stated.record_part import parse_part
from dashred.physics.system_schema import System

TWIN = re.compile(r"[A-Za-z0-9_-]+\Z")
DEVICE = re.compile(r"(cpu|cuda(:\d{1,3})?)\Z")
MAX_POINTS, MAX_STEPS = 1_000_000, 10_000_000


def check(settings: Settings, where: Where) -> None:
    """Check all values of a configuration.

    Raises:
        InputError: with the key, its location and its valid values.
    """
    check_limits(settings, Settings, "", where)
    check_snapshots(settings, where)
    check_system(settings.system, where)
    check_simulator(settings.system, where)
    _check_size(settings, where)
    _check_library(settings, where)
    _check_recording(settings, where)
    _check_sensor_split(settings.splits.sensors, settings.recording, where)
    if settings.simulation.held_out >= settings.simulation.members:
        raise InputError(
            "simulation.held_out leaves no members to train on",
            where=where("simulation.held_out"),
            hint=f"it must be less than simulation.members, {settings.simulation.members}",
        )
    if settings.simulation.memory is not None:
        parse_memory(settings.simulation.memory, where("simulation.memory"))
    check_cluster(settings, where)
    if not DEVICE.match(settings.device):
        raise InputError(
            f"unknown device {settings.device!r}", where=where("device"), hint="cpu, cuda or cuda:1"
        )
    check_trainer(settings, where)
    check_tracking(settings.tracking, where)


def check_limits(value: Any, kind: Any, key: str, where: Where) -> None:
    """Check every number of a tree against the limit in its type annotation.

    Raises:
        InputError: a number is not finite or outside its limit.
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
    """Return a type without ``| None``, and the limit in its annotation."""
    kind = required(kind)
    if get_origin(kind) is Annotated:
        bare, *carried = get_args(kind)
        return bare, next((mark for mark in carried if isinstance(mark, Limit)), None)
    return kind, None


def _check_size(settings: Settings, where: Where) -> None:
    """Check that the problem is not absurdly large, which indicates a typing error."""
    system, recording = settings.system, settings.recording
    points = math.prod(axis.points for axis in system.axes.values())
    if points > MAX_POINTS:
        hint = f"at most {MAX_POINTS}"
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
        # A system given as snapshots has no time step.
        if step is not None and span > MAX_STEPS * step:
            problem = f"{key}: {span:g} in steps of {step:g} needs too many steps"
            raise InputError(problem, where=where(key), hint=f"at most {MAX_STEPS}")


def _check_library(settings: Settings, where: Where) -> None:
    equations = [*settings.system.fields, *settings.system.let]
    for name, terms in (settings.library or {}).items():
        key = f"library.{name}"
        if name not in equations:
            raise InputError(
                f"library names {name}, which is neither a field nor a let of the system",
                where=where(key),
                hint=nearest(name, equations),
            )
        if twice := _first_repeated(terms):
            raise InputError(f"{key} contains {twice!r} twice", where=where(key))
    for key, numbers in {
        "shred.decoder": settings.shred.decoder,
        "latent_sindy.steps": settings.latent_sindy.steps,
    }.items():
        if numbers is not None and not numbers:
            raise InputError(f"{key} is empty", where=where(key))


def _check_recording(settings: Settings, where: Where) -> None:
    recording, system = settings.recording, settings.system
    _check_sensors(recording, where)
    _check_noise(recording.std, where)
    parse_columns(recording.columns, where("recording.columns"))
    parse_part(recording.begin, recording.end, where)
    parse_calibration(recording.calibration, where)
    parse_average(recording.average, where)
    for i, name in enumerate(recording.reads):
        if name not in system.fields and name not in system.let:
            raise InputError(
                f"recording.reads names {name}, which is neither a field nor a let",
                where=where(f"recording.reads[{i}]"),
                hint=nearest(name, [*system.fields, *system.let]),
            )
    if recording.twin is not None:
        _check_twin(recording, system, where)


def check_recorded(settings: Settings, where: Where) -> None:
    """Refuse a configuration that names nothing to analyse.

    Raises:
        InputError: neither a twin nor a recording.
    """
    if settings.recording.twin is None and settings.recording.path is None:
        raise InputError(
            "there is no recording to analyse",
            where=where("recording"),
            hint="give recording.path=FILE or recording.twin=NAME",
        )


def _check_noise(stated: Any, where: Where) -> None:
    by_name = stated if isinstance(stated, dict) else {"": stated}
    for name, noise in by_name.items():
        if noise is not None or name:
            key = f"recording.std.{name}" if name else "recording.std"
            parse_noise(noise, key, where(key))


def _check_sensors(recording: Recording, where: Where) -> None:
    count = recording.sensors
    if isinstance(count, str) or (type(count) is int and count >= 1):
        return
    raise InputError(
        f"recording.sensors must be a number, at least 1, or the path of a table; got {count!r}",
        where=where("recording.sensors"),
    )


def _check_twin(recording: Recording, system: System, where: Where) -> None:
    if system.integrator.dt is None and system.snapshots is None:
        raise InputError(
            "a twin needs a time step: its truth is a simulation",
            where=where("system.integrator"),
            hint="give system.integrator.dt",
        )
    if not TWIN.match(recording.twin or ""):
        raise InputError(
            f"{recording.twin!r} is not the name of a twin",
            where=where("recording.twin"),
            hint="for example recording.twin=a; give your own file with recording.path=FILE",
        )
    if recording.every is None or recording.every >= recording.duration:
        raise InputError(
            "a twin needs recording.every, the step between samples, less than recording.duration",
            where=where("recording.every"),
        )


def _check_sensor_split(split: SensorSplit, recording: Recording, where: Where) -> None:
    named: list[str] = []
    for role, value in (("validate", split.validate), ("test", split.test)):
        names = value if isinstance(value, list) else []
        number = type(value) is int and value >= 0
        if not number and not (isinstance(value, list) and all(isinstance(x, str) for x in names)):
            raise InputError(
                f"splits.sensors.{role} must be a number, at least 0, or a list of sensor names",
                where=where(f"splits.sensors.{role}"),
            )
        named += names
        if twice := _first_repeated(named):
            raise InputError(
                f"sensor {twice!r} is held out twice",
                where=where(f"splits.sensors.{role}"),
                hint="a sensor is used for validation or for testing, not for both",
            )
    fitted = recording.sensors if recording.twin and isinstance(recording.sensors, int) else None
    if fitted is not None and split.extra is not None and split.extra >= fitted:
        raise InputError(
            "splits.sensors.extra leaves no sensors for SHRED's input",
            where=where("splits.sensors.extra"),
            hint=f"it must be less than recording.sensors, {fitted}",
        )


def _first_repeated(items: list[str]) -> str | None:
    counts = Counter(items)
    return next((item for item in items if counts[item] > 1), None)
