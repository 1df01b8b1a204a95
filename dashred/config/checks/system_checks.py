"""Checks of the names in a system's declaration, and of the fields that its sections name.

The expressions are parsed by :mod:`dashred.physics.system`.
"""

from __future__ import annotations

import keyword
import math
from collections.abc import Iterable
from typing import Any

from dashred.config.checks.tables import check_tables
from dashred.config.coercion import evaluate
from dashred.config.schema.types import Where
from dashred.core.errors import InputError, nearest
from dashred.physics.system_schema import Axis, System

SMOOTH = ("length", "modes")
PROCESS = ("kind", *SMOOTH, "apply")
KIND = "gaussian-process"
# A step of finite volumes has dense matrices, and a check of the resolution quadruples the cells.
MOST_CELLS = 300
ENDS = ("periodic", "insulated", "fixed")
SIDES_EXAMPLE = "for example {left: {value: 10}, right: insulated}"


def check_system(system: System, where: Where) -> None:
    """Check that the declaration of a system is consistent.

    Raises:
        InputError: with the key, its location and the nearest valid choice.
    """
    _check_names(system, where)
    _check_axes(system, where)
    if not system.fields:
        raise InputError("a system needs at least one field", where=where("system.fields"))
    for section, entries in (("equations", system.equations), ("start", system.start)):
        _check_fields(f"system.{section}", entries, system, where)
        if system.snapshots is not None:
            continue
        if section == "equations" and system.simulator is not None:
            continue
        if absent := [name for name in system.fields if name not in entries]:
            raise InputError(
                f"system.{section} is missing the field {absent[0]}",
                where=where(f"system.{section}"),
            )
    for name, value in system.start.items():
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise InputError(
                f"system.start.{name} must be a number or an expression",
                where=where(f"system.start.{name}"),
            )
        if isinstance(value, int | float) and not math.isfinite(value):
            problem = f"system.start.{name} must be finite; got {value}"
            raise InputError(problem, where=where(f"system.start.{name}"))
    _check_spread(system, where)
    _check_parameter_spread(system, where)
    _check_parameter_per(system, where)
    check_tables(system, where)
    _check_front(system, where)


def _check_front(system: System, where: Where) -> None:
    if system.front is None:
        return
    place = where("system.front")
    if system.front not in system.fields:
        what = f"system.front names {system.front}, which is not a field"
        raise InputError(what, where=place, hint=nearest(system.front, system.fields))
    if [axis.ends for axis in system.axes.values()] != ["periodic"]:
        raise InputError("system.front needs a system with one periodic axis", where=place)


def _check_names(system: System, where: Where) -> None:
    from dashred.physics.expressions.parser import RESERVED

    taken: dict[str, str] = {}
    for section in ("axes", "fields", "parameters", "tables", "let", "inputs"):
        for name in getattr(system, section):
            at = where(f"system.{section}.{name}")
            if keyword.iskeyword(name):
                raise InputError(
                    f"{name!r} is a Python keyword and cannot be a name",
                    where=at,
                    hint=f"call it {'lam' if name == 'lambda' else name + '_0'}, for example",
                )
            if name in RESERVED:
                raise InputError(
                    f"{name!r} belongs to the equation language and cannot be a name",
                    where=at,
                    hint=f"call it {name}_0, for example",
                )
            if name in taken:
                raise InputError(f"the name {name!r} is also used in {taken[name]}", where=at)
            taken[name] = f"system.{section}"


def _check_axes(system: System, where: Where) -> None:
    if len(system.axes) > 2:
        raise InputError("a system has at most two axes", where=where("system.axes"))
    # The coordinates of nodes have no ends.
    for name, axis in system.axes.items() if system.nodes is None else ():
        _check_ends(name, axis, system, where)
        if axis.ends in ENDS[1:] and system.integrator.space != "spectral":
            raise InputError(
                f"an axis with {axis.ends} ends needs spectral operators",
                where=where(f"system.axes.{name}.ends"),
                hint="remove integrator.space, or make the axis periodic",
            )


def _check_ends(name: str, axis: Axis, system: System, where: Where) -> None:
    """Check the form of ``ends``; the conditions for each side are checked with the equations."""
    key = f"system.axes.{name}.ends"
    if not isinstance(axis.ends, str | dict) or (
        isinstance(axis.ends, str) and axis.ends not in ENDS
    ):
        what = f"{key} must be {', '.join(ENDS)}, or a section of sides; got {axis.ends!r}"
        hint = nearest(axis.ends, ENDS) if isinstance(axis.ends, str) else SIDES_EXAMPLE
        raise InputError(what, where=where(key), hint=hint)
    if axis.coordinates == "radial" and axis.ends == "periodic":
        what = f"the radial axis {name} has no condition at its outer end"
        raise InputError(what, where=where(f"system.axes.{name}"), hint=f"set {key}: insulated")
    has_sides = isinstance(axis.ends, dict) or axis.coordinates == "radial"
    if has_sides and len(system.axes) > 1:
        what = "conditions for each side, and radial axes, are for systems with one axis"
        hint = f"set {key} to {', '.join(ENDS)}"
        raise InputError(what, where=where(key), hint=hint)
    if has_sides and system.integrator.space != "spectral":
        what = "an axis with a condition for each side has finite volumes"
        hint = "remove integrator.space"
        raise InputError(what, where=where("system.integrator.space"), hint=hint)
    if has_sides and axis.points * len(system.fields) > MOST_CELLS:
        what = f"{axis.points} cells of {len(system.fields)} fields are too many for one run"
        hint = f"conditions for each side allow at most {MOST_CELLS} cells, over all fields"
        raise InputError(what, where=where(f"system.axes.{name}.points"), hint=hint)
    if isinstance(axis.ends, dict) and system.snapshots is not None:
        what = "a black-box simulator cannot have a condition for each side"
        raise InputError(what, where=where(key), hint=f"remove {key}")


def _check_fields(key: str, names: Iterable[str], system: System, where: Where) -> None:
    for name in names:
        if name not in system.fields:
            raise InputError(
                f"{key} names {name}, which is not a field",
                where=where(f"{key}.{name}"),
                hint=nearest(name, system.fields),
            )


def _check_spread(system: System, where: Where) -> None:
    key, spread = "system.spread", system.spread
    smooth = [name for name in SMOOTH if name in spread and name not in system.fields]
    if "length" in smooth and not _positive(spread["length"]):
        raise InputError(f"{key}.length must be a positive number", where=where(f"{key}.length"))
    if "modes" in smooth and not (isinstance(spread["modes"], int) and _positive(spread["modes"])):
        raise InputError(f"{key}.modes must be a positive integer", where=where(f"{key}.modes"))
    if "kind" in spread and "kind" not in system.fields:
        _check_process(spread, system, where)
        return
    moved = [name for name in spread if name not in smooth]
    _check_fields(key, moved, system, where)
    for name in moved:
        _check_deviation(spread[name], f"{key}.{name}", where)


def _check_parameter_spread(system: System, where: Where) -> None:
    for name, spread in system.parameter_spread.items():
        place = where(f"system.parameter_spread.{name}")
        if name not in system.parameters:
            what = f"system.parameter_spread names {name}, which is not a parameter"
            raise InputError(what, where=place, hint=nearest(name, system.parameters))
        if not _positive(spread):
            what = f"the spread of {name} must be a positive number; got {spread:g}"
            hint = "omit the spread of a parameter whose value is exact"
            raise InputError(what, where=place, hint=hint)


def _check_parameter_per(system: System, where: Where) -> None:
    for name, per in system.parameter_per.items():
        place = where(f"system.parameter_per.{name}")
        if per != "episode":
            what = f"{name} has a value per {per!r}, but only per: episode is possible"
            hint = "write episode; a subject whose recording is one stretch is an episode"
            raise InputError(what, where=place, hint=hint)
        if name not in system.parameters:
            what = f"system.parameter_per names {name}, which is not a parameter"
            raise InputError(what, where=place, hint=nearest(name, system.parameters))
        if name not in system.parameter_spread:
            what = f"{name} has a value per episode, but no spread"
            hint = f"for example {name}: {{value: 1, spread: 0.2, per: episode}}"
            raise InputError(what, where=place, hint=hint)


def _check_process(spread: dict[str, Any], system: System, where: Where) -> None:
    key = "system.spread"
    if spread["kind"] != KIND:
        raise InputError(f"unknown kind {spread['kind']!r}", where=where(f"{key}.kind"), hint=KIND)
    for name in spread:
        if name not in PROCESS:
            hint = nearest(name, PROCESS)
            raise InputError(f"unknown key {key}.{name}", where=where(f"{key}.{name}"), hint=hint)
    if absent := [name for name in PROCESS if name not in spread]:
        raise InputError(f"missing: {key}.{absent[0]}", where=where(key))
    if not isinstance(spread["apply"], dict) or not spread["apply"]:
        hint = "for example apply: {u: u*(1 + 0.1*g)}"
        raise InputError(f"{key}.apply must be a section of fields", where=where(key), hint=hint)
    _check_fields(f"{key}.apply", spread["apply"], system, where)


def _check_deviation(value: Any, key: str, where: Where) -> None:
    text = value.strip().removesuffix("%") if isinstance(value, str) else value
    number = evaluate(text, key, where) if isinstance(text, str) else text
    if number != 0 and not _positive(number):
        hint = "give a number, at least 0, or a share of the field's rms such as 10%"
        raise InputError(f"{key} is {value!r}", where=where(key), hint=hint)


def _positive(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and 0 < value < math.inf
