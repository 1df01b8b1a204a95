"""Dotted keys on the tree of dataclasses: what each may hold, and the nearest valid one."""

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
    """The kind without its ``| None``."""
    if get_origin(kind) not in (Union, UnionType):
        return kind
    (rest,) = (part for part in get_args(kind) if part is not NoneType)
    return rest


def optional(kind: Any) -> bool:
    """Whether null will do."""
    return kind is Any or NoneType in get_args(kind)


@cache
def hints(kind: type) -> dict[str, Any]:
    """The keys of a section, and the kind of each; ``class`` is ``class_`` to Python."""
    return {name.rstrip("_"): member for name, member in get_type_hints(kind).items()}


def child(kind: Any, name: str, key: str, where: Where) -> Any:
    """The kind of the key ``name`` within a section of this kind.

    Raises:
        InputError: the section has no such key.
    """
    kind = required(kind)
    if kind is Any:
        return Any
    if get_origin(kind) is dict:
        if not NAME.match(name):
            hint = "a name is letters, digits and _, beginning with a letter"
            raise InputError(f"{name!r} is not a name", where=where(key), hint=hint)
        return get_args(kind)[1]
    if is_dataclass(kind) and isinstance(kind, type):
        if name in hints(kind):
            return hints(kind)[name]
        parent = key[: -len(name)]
        close = _elsewhere(name) or nearest(key, [parent + sibling for sibling in hints(kind)])
        raise InputError(f"unknown key {key}", where=where(key), hint=close)
    raise InputError(
        f"unknown key {key}: {key.rpartition('.')[0]} is {in_words(kind)}", where=where(key)
    )


def kind_at(key: str, where: Where) -> Any:
    """The kind of a dotted key, list items (``key[0]``) included.

    Raises:
        InputError: there is no such key; the hint names the nearest.
    """
    kind: Any = Settings
    path = ""
    for part in key.split("."):
        name, *items = part.replace("]", "").split("[")
        path = f"{path}.{name}" if path else name
        kind = child(kind, name, path, where)
        for item in items:
            if get_origin(required(kind)) is not list or not item.isdecimal():
                raise InputError(f"unknown key {key}", where=where(key), hint=in_words(kind))
            kind = get_args(required(kind))[0]
    return kind


def in_words(kind: Any) -> str:
    """What a value of this kind is called in a message."""
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


def _elsewhere(name: str) -> str | None:
    """A key of this very name in another section, when there is just one."""
    found = [key for key in _keys(Settings) if key.rpartition(".")[2] == name]
    return f"did you mean {found[0]}?" if len(found) == 1 else None


def _keys(kind: type, parent: str = "") -> Iterator[str]:
    for name, member in hints(kind).items():
        bare = required(member)
        yield parent + name
        if is_dataclass(bare) and isinstance(bare, type):
            yield from _keys(bare, f"{parent}{name}.")
