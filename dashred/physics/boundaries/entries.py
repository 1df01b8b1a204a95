"""The form of the conditions for each side, as the configuration states them.

Each condition gets a parameter of its own, which is added to it: ``T_left_offset``, 0 unless it is
stated. A wrong condition is then a wrong parameter.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from dashred.core.errors import InputError, nearest

if TYPE_CHECKING:
    from dashred.physics import system_schema as schema

SIDES = ("left", "right")
KINDS = ("value", "slope", "flux")
WORDS = ("insulated", "fixed", "outflow")
KIND_OF_WORD = {"insulated": "slope", "fixed": "value"}
EXAMPLE = "for example left: {value: 10}"


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
    entries = () if axis is None else stated_entries(config, axis, where)
    return {
        offset_name(field, side): f"{KIND_OF_WORD.get(word, word)} of {field} at the {side} end"
        for field, side, (word, _), _ in entries
        if word != "outflow"
    }


def stated_entries(
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
