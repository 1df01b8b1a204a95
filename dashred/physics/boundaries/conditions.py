"""Conditions for each side of the only axis: read from the configuration, and checked.

``value: g`` gives the field at the end of the axis, and ``slope: s`` its derivative along the axis.
``flux: q`` is the flux along the axis of an equation with one diffusive term: with ``D*d(T, x, 2)``
it is ``-D*d(T, x)``, and with ``c*d(k*d(T, x), x)`` it is ``-k*d(T, x)``. Both signs are those of
the coordinate: a positive flux enters at the left end and leaves at the right end. ``insulated`` is
slope 0 and ``fixed`` is value 0. ``outflow`` lets what arrives leave: the field is a straight line
through the last two cells.

Each value, slope and flux gets a parameter of its own, which is added to it:
``T_left_offset``, 0 unless it is stated. A wrong boundary is then a wrong parameter.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dashred.core.errors import InputError, nearest
from dashred.physics.boundaries.spatial_order import conditions_needed, flux_coefficients
from dashred.physics.expressions.algebra import (
    ZERO,
    Expr,
    Name,
    Number,
    add,
    multiply,
    names,
    power,
    substitute,
)

if TYPE_CHECKING:
    from dashred.physics import system_schema as schema

SIDES = ("left", "right")
KINDS = ("value", "slope", "flux")
WORDS = ("insulated", "fixed", "outflow")
KIND_OF_WORD = {"insulated": "slope", "fixed": "value"}
EXAMPLE = "for example left: {value: 10}"


@dataclass(frozen=True)
class Condition:
    """What holds for one field at one end of the axis.

    Attributes:
        kind: ``value``, ``slope`` or ``outflow``.
        given: the value or slope, with its offset; 0 for outflow.
        key: its configuration key.
    """

    kind: str
    given: Expr
    key: str


Sides = dict[str, Condition]
"""The condition at each side."""


def one_sided_axis(config: schema.System) -> str | None:
    """Return the name of the axis with a condition for each side; None if there is none."""
    for name, axis in config.axes.items():
        if isinstance(axis.ends, dict) or axis.coordinates == "radial":
            return name
    return None


def offset_name(field: str, side: str) -> str:
    """Return the name of the parameter that is added to a condition."""
    return f"{field}_{side}_offset"


def with_offsets(config: schema.System, where: Callable[[str], str]) -> schema.System:
    """Return a declaration with the offset of every condition as a parameter.

    Raises:
        InputError: the conditions have the wrong form.
    """
    own = dict.fromkeys(offset_meanings(config, where), 0.0)
    return dataclasses.replace(config, parameters=own | config.parameters)


def offset_meanings(config: schema.System, where: Callable[[str], str]) -> dict[str, str]:
    """Return what every offset is added to, by name: ``value of T at the left end``.

    Raises:
        InputError: the conditions have the wrong form.
    """
    axis = one_sided_axis(config)
    entries = () if axis is None else _entries(config, axis, where)
    return {
        offset_name(field, side): f"{KIND_OF_WORD.get(word, word)} of {field} at the {side} end"
        for field, side, (word, _), _ in entries
        if word != "outflow"
    }


def read_conditions(
    config: schema.System,
    equations: Mapping[str, Expr],
    parse: Callable[[str, str], Expr],
    where: Callable[[str], str],
) -> dict[str, Sides]:
    """Return the conditions of every field, by side; the left end of a radius has none.

    Args:
        config: a declaration for which :func:`one_sided_axis` is an axis.
        equations: tendency of each field, without lets.
        parse: (text, configuration key) → expression without lets.
        where: returns the location of a configuration key.

    Raises:
        InputError: a condition is missing, contradicts another, or cannot be read.
    """
    axis = one_sided_axis(config)
    assert axis is not None
    found: dict[str, Sides] = {field: {} for field in config.fields}
    for field, side, (word, text), key in _entries(config, axis, where):
        given: Expr = ZERO
        if word != "outflow":
            given = add((_clocked(text, key, config, parse, where), Name(offset_name(field, side))))
        if word == "flux":
            diffusivity = _diffusivity(equations[field], field, side, config, axis, where(key))
            given = multiply((Number(-1.0), given, power(diffusivity, Number(-1.0))))
        kind = "slope" if word == "flux" else KIND_OF_WORD.get(word, word)
        found[field][side] = Condition(kind, given, key)
    for field, sides in found.items():
        _check_number(field, sides, config, axis, equations, where)
    return found


def _entries(
    config: schema.System, axis: str, where: Callable[[str], str]
) -> Iterator[tuple[str, str, tuple[str, str], str]]:
    """Yield field, side, word or kind with its text, and configuration key."""
    ends: Any = config.axes[axis].ends
    base = f"system.axes.{axis}.ends"
    radial = config.axes[axis].coordinates == "radial"
    if isinstance(ends, str):
        ends = {"right": ends}
    sides = ("right",) if radial else SIDES
    for side in ends:
        if side not in sides:
            what, hint = f"{base} names {side!r}, which is not a side", nearest(str(side), SIDES)
            if side == "left":
                what, hint = "the centre of a radial axis has no condition", "remove left"
            raise InputError(what, where=where(f"{base}.{side}"), hint=hint)
    for side in sides:
        key = f"{base}.{side}"
        if side not in ends:
            what = f"{base} has no condition for the {side} end"
            raise InputError(what, where=where(base), hint=f"add {side}: insulated, for example")
        given = ends[side]
        by_field = isinstance(given, dict) and bool(given) and not set(given) <= {*KINDS}
        for name in given if by_field else ():
            if name in KINDS:
                what = f"{key} has conditions both for all fields and for one of them"
                hint = "list the condition of every field by its name"
                raise InputError(what, where=where(f"{key}.{name}"), hint=hint)
            if name not in config.fields:
                what = f"{key} names {name!r}, which is neither a field nor a condition"
                hint = nearest(str(name), (*config.fields, *KINDS))
                raise InputError(what, where=where(f"{key}.{name}"), hint=hint)
        for field in config.fields:
            own, place = (given.get(field), f"{key}.{field}") if by_field else (given, key)
            if own is not None:
                yield field, side, *_condition(own, field, side, place, where)


def _condition(
    given: Any, field: str, side: str, key: str, where: Callable[[str], str]
) -> tuple[tuple[str, str], str]:
    """Return the word or kind of a condition with its text, and the key of the text."""
    if isinstance(given, str):
        if given in WORDS:
            return (given, "0"), key
        what = f"{given!r} is not a condition for one end"
        hint = nearest(given, WORDS)
        if given == "periodic":
            hint = "a periodic axis has no ends: write ends: periodic for the whole axis"
        elif hint.startswith("one of"):
            hint = f"give {', '.join(WORDS)}, or an expression as {{value: {given}}}"
        raise InputError(what, where=where(key), hint=hint)
    if isinstance(given, dict):
        if len(given) > 1 and set(given) <= {*KINDS}:
            what = f"{field} has {len(given)} conditions at the {side} end: {' and '.join(given)}"
            raise InputError(what, where=where(key), hint="one is enough: keep one of them")
        for kind, text in given.items():
            if kind not in KINDS:
                what = f"{kind!r} is not a condition"
                raise InputError(what, where=where(f"{key}.{kind}"), hint=nearest(kind, KINDS))
            is_number = isinstance(text, int | float) and not isinstance(text, bool)
            if not is_number and not isinstance(text, str):
                what = f"the {kind} of {field} at the {side} end must be a number or an expression"
                raise InputError(what, where=where(f"{key}.{kind}"), hint=EXAMPLE)
            return (kind, str(text)), f"{key}.{kind}"
    what = f"the condition of {field} at the {side} end must be a word or a section of keys"
    hint = f"{', '.join(WORDS)}, {{value: …}}, {{slope: …}} or {{flux: …}}"
    raise InputError(what, where=where(key), hint=hint)


def _clocked(
    text: str,
    key: str,
    config: schema.System,
    parse: Callable[[str, str], Expr],
    where: Callable[[str], str],
) -> Expr:
    """Return an expression in t, parameters and inputs.

    Raises:
        InputError: it reads another name.
    """
    expr = parse(text, key)
    if read := names(expr) & ({*config.fields, *config.axes}):
        kind = "field" if min(read) in config.fields else "coordinate"
        raise InputError(
            f"a condition at an end cannot depend on the {kind} {min(read)}",
            where=where(key),
            hint="use t, parameters and inputs",
        )
    return expr


def _check_number(
    field: str,
    sides: Sides,
    config: schema.System,
    axis: str,
    equations: Mapping[str, Expr],
    where: Callable[[str], str],
) -> None:
    """Check that a field has as many conditions as its equation needs.

    Raises:
        InputError: it has more or fewer, or its equation needs more than one at each end.
    """
    place = where(f"system.axes.{axis}.ends")
    needed = conditions_needed(equations[field], field, tuple(config.axes))
    stated = [side for side, condition in sides.items() if condition.kind != "outflow"]
    expected = ("right",) if config.axes[axis].coordinates == "radial" else SIDES
    if needed > 2:
        what = f"the equation of {field} has a derivative of order {needed}, which needs two"
        hint = "conditions for each side are for first and second derivatives"
        raise InputError(f"{what} conditions at each end", where=place, hint=hint)
    if needed == 0:
        if any(sides[side].given != Name(offset_name(field, side)) for side in stated):
            what = f"{field} has a condition, but its equation has no derivative along {axis}"
            raise InputError(what, where=place, hint=f"remove it; give {field} none")
        for side in expected:
            sides[side] = Condition("outflow", ZERO, f"system.axes.{axis}.ends")
        return
    if absent := [side for side in expected if side not in sides]:
        what = f"{field} has no condition at the {absent[0]} end"
        raise InputError(what, where=place, hint=f"add {field}: insulated, for example")
    if needed == 1 and len(stated) == 2:
        what = f"{field} has conditions at both ends, but its equation has first derivatives only"
        hint = "give outflow at the end where the flow leaves"
        raise InputError(what, where=place, hint=hint)
    if needed == 1 and not stated:
        what = f"{field} has outflow at both ends, so nothing says what flows in"
        raise InputError(what, where=place, hint="give its value where the flow enters")


def _diffusivity(
    equation: Expr, field: str, side: str, config: schema.System, axis: str, place: str
) -> Expr:
    """Return the coefficient k of the flux ``-k*d(u, x)`` at one end.

    Raises:
        InputError: the equation has no single diffusive term, or k depends on a field.
    """
    own = config.axes[axis]
    found = flux_coefficients(equation, field, axis, own.coordinates == "radial")
    if len(found) != 1 or names(found[0]) & set(config.fields):
        number = "no diffusive term" if not found else "more than one diffusive term"
        problem = number if len(found) != 1 else "a diffusivity that depends on a field"
        hint = f"give the slope d({field}, {axis}) instead: {{slope: …}}"
        what = f"the equation of {field} has {problem}, so its flux is not determined"
        raise InputError(what, where=place, hint=hint)
    end = Number(0.0 if side == "left" else float(own.length))
    return substitute(found[0], {axis: end})
