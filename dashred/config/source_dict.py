"""Read a configuration from a Python dict, as :mod:`dashred.config.source` reads it from YAML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dashred.config.parameter_spreads import plain_key
from dashred.config.source import MAX_DEPTH, MAX_VALUES, Source, check_text
from dashred.core.errors import InputError


def source_from_dict(values: Mapping[str, Any], label: str) -> Source:
    """Return a nested dict as a layer of a configuration.

    Args:
        values: dict of text, numbers, booleans, None, lists and dicts.
        label: name of the dict in messages; a key is ``LABEL, KEY``.

    Raises:
        InputError: a key is not text, or a value has no YAML form.
    """
    if not isinstance(values, Mapping):
        what = f"expected a dict of keys and values, got {type(values).__name__}"
        raise InputError(what, where=label)
    reader = _Reader(label)
    return Source(reader.mapping(values, ""), reader.lines | {"": label})


def overrides_from_dict(overrides: Mapping[str, Any], label: str) -> Source:
    """Return overrides as a layer; keys are dotted, nested, or both: ``{"shred.lags": 30}``.

    Raises:
        InputError: see :func:`source_from_dict`; or a key has both a value and keys below it, or is
            given twice.
    """
    nested: dict[str, Any] = {}
    leaves: dict[str, str] = {"": label}
    for leaf, value in _leaves(source_from_dict(overrides, label).values, ""):
        key = plain_key(leaf, label)
        *sections, name = key.split(".")
        below = nested
        for section in sections:
            below = below.setdefault(section, {})
            if not isinstance(below, dict):
                raise InputError(f"{section} of {key} is given as a value too", where=label)
        if name in below:
            raise InputError(f"{key} is given twice", where=label)
        below[name] = value
        leaves[key] = label
    return Source(nested, leaves)


def _leaves(values: Mapping[str, Any], parent: str) -> list[tuple[str, Any]]:
    result = []
    for name, value in values.items():
        key = f"{parent}.{name}" if parent else name
        result += _leaves(value, key) if isinstance(value, dict) and value else [(key, value)]
    return result


class _Reader:
    """Copies values, and records the location of every key."""

    def __init__(self, label: str) -> None:
        self.label, self.count = label, 0
        self.lines: dict[str, str] = {}

    def mapping(self, values: Mapping[Any, Any], parent: str) -> dict[str, Any]:
        result = {}
        for name, value in values.items():
            if not isinstance(name, str) or not name:
                where = self._place(parent)
                raise InputError(f"a key must be a name, not {name!r}", where=where)
            key = f"{parent}.{name}" if parent else name
            result[check_text(name, where=self._place(parent))] = self.value(value, key)
        return result

    def value(self, value: Any, key: str) -> Any:
        where = self.lines[key] = self._place(key)
        self.count += 1
        if self.count > MAX_VALUES or key.count(".") + key.count("[") > MAX_DEPTH:
            raise InputError("too many values, or nested too deeply", where=where)
        if isinstance(value, Mapping):
            return self.mapping(value, key)
        if isinstance(value, str):
            return check_text(value, where=where)
        if isinstance(value, Sequence) and not isinstance(value, bytes):
            return [self.value(item, f"{key}[{i}]") for i, item in enumerate(value)]
        # NumPy scalars are converted to Python numbers.
        number = value.item() if getattr(value, "shape", None) == () else value
        if isinstance(number, float) and not math.isfinite(number):
            raise InputError(f"{key} must be finite; got {number}", where=where)
        if number is None or isinstance(number, bool | int | float):
            return number
        hint = "write texts, numbers, lists and dicts"
        what = f"{key} cannot hold a value of the type {type(value).__name__}"
        raise InputError(what, where=where, hint=hint)

    def _place(self, key: str) -> str:
        return f"{self.label}, {key}" if key else self.label
