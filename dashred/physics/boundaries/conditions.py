"""Conditions for each side of the only axis: read from the configuration, and checked.

``value: g`` gives the field at the end of the axis, and ``slope: s`` its derivative along the axis.
``flux: q`` is the flux along the axis of an equation with one diffusive term: with ``D*d(T, x, 2)``
it is ``-D*d(T, x)``, and with ``c*d(k*d(T, x), x)`` it is ``-k*d(T, x)``. Both signs are those of
the coordinate: a positive flux enters at the left end and leaves at the right end. ``insulated`` is
slope 0 and ``fixed`` is value 0. ``outflow`` lets what arrives leave: the field is a straight line
through the last two cells.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dashred.core.errors import InputError
from dashred.physics.boundaries.entries import (
    KIND_OF_WORD,
    SIDES,
    offset_name,
    one_sided_axis,
    stated_entries,
)
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
    for field, side, (word, text), key in stated_entries(config, axis, where):
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
