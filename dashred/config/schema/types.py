"""Types of dotted keys in the tree of dataclasses, and hints for unknown keys."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from dashred.config.schema.settings import Settings
from dashred.core.errors import InputError, nearest

Where = Callable[[str], str]
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
WORDS = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


def required(kind: Any) -> Any:
    """Return the type without ``| None``."""
    if get_origin(kind) not in (Union, UnionType):
        return kind
    (rest,) = (part for part in get_args(kind) if part is not NoneType)
    return rest


def optional(kind: Any) -> bool:
    """Return whether null is allowed."""
    return kind is Any or NoneType in get_args(kind)


@cache
def hints(kind: type) -> dict[str, Any]:
    """Return the type of each key of a section; the attribute ``class_`` is the key ``class``."""
    return {name.rstrip("_"): member for name, member in get_type_hints(kind).items()}


def child(kind: Any, name: str, key: str, where: Where) -> Any:
    """Return the type of the key ``name`` in a section of type ``kind``.

    Raises:
        InputError: the section has no such key.
    """
    kind = required(kind)
    if kind is Any:
        return Any
    if get_origin(kind) is dict:
        if not NAME.match(name):
            hint = "a name has letters, digits and _, and begins with a letter"
            raise InputError(f"{name!r} is not a valid name", where=where(key), hint=hint)
        return get_args(kind)[1]
    if is_dataclass(kind) and isinstance(kind, type):
        if name in hints(kind):
            return hints(kind)[name]
        parent = key[: -len(name)]
        close = _in_other_section(name) or nearest(
            key, [parent + sibling for sibling in hints(kind)]
        )
        raise InputError(f"unknown key {key}", where=where(key), hint=close)
    raise InputError(
        f"unknown key {key}: {key.rpartition('.')[0]} is {describe_kind(kind)}", where=where(key)
    )


def kind_at(key: str, where: Where) -> Any:
    """Return the type of a dotted key, which may be a list item (``key[0]``).

    Raises:
        InputError: there is no such key; the hint gives the nearest.
    """
    kind: Any = Settings
    path = ""
    for part in key.split("."):
        name, *items = part.replace("]", "").split("[")
        path = f"{path}.{name}" if path else name
        kind = child(kind, name, path, where)
        for item in items:
            if get_origin(required(kind)) is not list or not item.isdecimal():
                raise InputError(f"unknown key {key}", where=where(key), hint=describe_kind(kind))
            kind = get_args(required(kind))[0]
    return kind


def describe_kind(kind: Any) -> str:
    """Describe a type in an error message."""
    bare = required(kind)
    origin = get_origin(bare)
    if origin is Literal:
        words = "one of: " + ", ".join(get_args(bare))
    elif origin is list:
        words = "a list, such as [a, b]"
    elif origin is dict or is_dataclass(bare):
        words = "a section of keys"
    else:
        words = WORDS.get(bare, "a value")
    return f"{words}, or null" if optional(kind) else words


def _in_other_section(name: str) -> str | None:
    """Return a hint if exactly one other section has a key of this name."""
    found = [key for key in _keys(Settings) if key.rpartition(".")[2] == name]
    return f"did you mean {found[0]}?" if len(found) == 1 else None


def _keys(kind: type, parent: str = "") -> Iterator[str]:
    for name, member in hints(kind).items():
        bare = required(member)
        yield parent + name
        if is_dataclass(bare) and isinstance(bare, type):
            yield from _keys(bare, f"{parent}{name}.")
