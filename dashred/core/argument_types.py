"""Readers of the values on a command line: each takes a text, and says what is wrong with it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from dashred.core.files.user_path import user_path

MOST = 1_000_000_000
RANGE = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?\Z")
NUMBER = re.compile(r"-?(\d+(\.\d*)?|\.\d+)(e-?\d{1,2})?\Z")
T = TypeVar("T")


def read_path(text: str) -> Path:
    """Read a path; ``~`` is the home folder.

    Raises:
        InputError: no file can have this name.
    """
    return user_path(text, "command line")


def read_absolute(text: str) -> Path:
    """Read a path as it is from anywhere.

    Raises:
        InputError: no file can have this name.
    """
    return read_path(text).absolute()


def read_number(text: str) -> float:
    """Read a decimal number.

    Raises:
        ValueError: it is none, or not finite.
    """
    if not NUMBER.match(text) or not math.isfinite(float(text)):
        raise ValueError(f"{text!r} is no number")
    return float(text)


def whole(*, at_least: int = 0, at_most: int = MOST) -> Callable[[str], int]:
    """Return a reader of whole numbers within limits."""

    def read(text: str) -> int:
        if not re.fullmatch(r"\d{1,9}", text, re.ASCII):
            raise ValueError(f"{text!r} is no whole number")
        if not at_least <= int(text) <= at_most:
            raise ValueError(f"{text} is not between {at_least} and {at_most}")
        return int(text)

    return read


def list_of(read: Callable[[str], T]) -> Callable[[str], tuple[T, ...]]:
    """Return a reader of values with commas between them; a value given again counts once."""

    def read_all(text: str) -> tuple[T, ...]:
        return tuple(dict.fromkeys(map(read, _items(text))))

    return read_all


def ranges(*, at_most: int) -> Callable[[str], tuple[int, ...]]:
    """Return a reader of ``0-4``, ``0,1,3`` or a mixture of both, a range of so many at most."""

    def read(text: str) -> tuple[int, ...]:
        found: dict[int, None] = {}
        for item in _items(text):
            match = RANGE.match(item)
            if not match:
                raise ValueError(f"{item!r} is neither a whole number nor a range of them")
            first, last = int(match[1]), int(match[2] or match[1])
            if last < first:
                raise ValueError(f"{item} runs backwards")
            if last - first >= at_most:
                raise ValueError(f"{item} is more than {at_most} numbers")
            found |= dict.fromkeys(range(first, last + 1))
        return tuple(found)

    return read


def _items(text: str) -> list[str]:
    items = [item.strip() for item in text.split(",")]
    if not all(items):
        raise ValueError("there is an empty value")
    return items
