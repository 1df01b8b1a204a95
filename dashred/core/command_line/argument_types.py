"""Readers of the values of command-line arguments: each converts a text or raises an error."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from dashred.core.files.user_path import user_path

MAX_INTEGER = 1_000_000_000
RANGE = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?\Z")
NUMBER = re.compile(r"-?(\d+(\.\d*)?|\.\d+)(e-?\d{1,2})?\Z")
T = TypeVar("T")


def read_path(text: str) -> Path:
    """Read a path; ``~`` is the home folder.

    Raises:
        InputError: the text is not a valid path.
    """
    return user_path(text, "command line")


def read_absolute_path(text: str) -> Path:
    """Read a path and make it absolute.

    Raises:
        InputError: the text is not a valid path.
    """
    return read_path(text).absolute()


def read_number(text: str) -> float:
    """Read a decimal number.

    Raises:
        ValueError: the text is not a finite number.
    """
    if not NUMBER.match(text) or not math.isfinite(float(text)):
        raise ValueError(f"{text!r} is not a number")
    return float(text)


def integer_reader(*, at_least: int = 0, at_most: int = MAX_INTEGER) -> Callable[[str], int]:
    """Return a reader of whole numbers within limits."""

    def read(text: str) -> int:
        if not re.fullmatch(r"\d{1,9}", text, re.ASCII):
            raise ValueError(f"{text!r} is not a whole number")
        if not at_least <= int(text) <= at_most:
            raise ValueError(f"{text} is not between {at_least} and {at_most}")
        return int(text)

    return read


def list_reader(read: Callable[[str], T]) -> Callable[[str], tuple[T, ...]]:
    """Return a reader of comma-separated values; repeated values count once."""

    def read_all(text: str) -> tuple[T, ...]:
        return tuple(dict.fromkeys(map(read, _items(text))))

    return read_all


def ranges_reader(*, at_most: int) -> Callable[[str], tuple[int, ...]]:
    """Return a reader of ``0-4``, ``0,1,3`` or a mixture; a range has at most ``at_most``."""

    def read(text: str) -> tuple[int, ...]:
        result: dict[int, None] = {}
        for item in _items(text):
            match = RANGE.match(item)
            if not match:
                raise ValueError(f"{item!r} is neither a whole number nor a range of whole numbers")
            first, last = int(match[1]), int(match[2] or match[1])
            if last < first:
                raise ValueError(f"{item} is decreasing")
            if last - first >= at_most:
                raise ValueError(f"{item} is more than {at_most} numbers")
            result |= dict.fromkeys(range(first, last + 1))
        return tuple(result)

    return read


def _items(text: str) -> list[str]:
    items = [item.strip() for item in text.split(",")]
    if not all(items):
        raise ValueError("there is an empty value")
    return items
