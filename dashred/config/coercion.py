"""Check the shape of configuration values against their types, and evaluate numbers."""

from __future__ import annotations

import re
import sys
from dataclasses import is_dataclass
from typing import Any, get_args, get_origin

from dashred.config.schema.types import Where, child, describe_kind, optional, required
from dashred.core.errors import InputError


def coerce(value: Any, kind: Any, key: str, where: Where) -> Any:
    """Return a value of its type, with the number of a text where a number is needed.

    Raises:
        InputError: a value of the wrong type, or an invalid number.
    """
    bare = required(kind)
    if value is None and optional(kind):
        return None
    if is_dataclass(bare) or get_origin(bare) is dict:
        if not isinstance(value, dict):
            raise type_error(value, kind, key, where)
        return {name: _coerce_member(x, kind, name, key, where) for name, x in value.items()}
    if get_origin(bare) is list:
        if not isinstance(value, list):
            raise type_error(value, kind, key, where)
        (item,) = get_args(bare)
        return [coerce(x, item, f"{key}[{i}]", where) for i, x in enumerate(value)]
    if bare is not Any and (value is None or isinstance(value, dict | list)):
        raise type_error(value, kind, key, where)
    if bare is float and isinstance(value, str):
        return evaluate(value, key, where)
    if bare is float and type(value) is int and abs(value) > sys.float_info.max:
        raise InputError(f"{key} must be finite; got a larger number", where=where(key))
    if bare in (int, bool) and type(value) is not bare:
        # OmegaConf would also accept '1_0' as 10, yes as true, and true as 1.
        raise type_error(value, kind, key, where)
    return value


def _coerce_member(value: Any, kind: Any, name: str, parent: str, where: Where) -> Any:
    key = f"{parent}.{name}" if parent else name
    return coerce(value, child(kind, name, key, where), key, where)


def evaluate(text: str, key: str, where: Where) -> float:
    """Evaluate arithmetic such as ``2*pi``.

    Raises:
        InputError: the text is not a number.
    """
    # Imported here, because few configurations need the equation language at this point.
    from dashred.physics.expressions.parser import number

    try:
        return number(text, where=where(key))
    except InputError as error:
        what = f"{key} must be a number: {error.what}"
        raise InputError(what, where=error.where, hint=error.hint) from None


def type_error(value: Any, kind: Any, key: str, where: Where) -> InputError:
    """Return the error of a value of the wrong type."""
    given = {dict: "a section of keys", list: "a list", type(None): "nothing"}
    got = given.get(type(value)) or repr(value)
    if re.fullmatch(r"system\.inputs\.\w+", key):
        what = f"{key} must be the name of a column, or a section of keys; got {got}"
        return InputError(what, where=where(key), hint="for example {column: voltage, hold: true}")
    return InputError(f"{key} must be {describe_kind(kind)}; got {got}", where=where(key))
