"""The short form of an uncertain parameter, written out.

``parameters: {R: {value: 2.7, spread: 1.0}}`` stands for the plain keys ``parameters: {R: 2.7}``
and ``parameter_spread: {R: 1.0}``.
"""

from __future__ import annotations

import re
from typing import Any

from dashred.config.layers import where_in
from dashred.config.schema.types import Where
from dashred.config.source import Source, section_of
from dashred.core.errors import InputError, nearest

# The plain section of each key of the short form.
SECTIONS = {"value": "parameters", "spread": "parameter_spread", "per": "parameter_per"}
SHORT_KEY = re.compile(r"system\.parameters\.([^.\[]+)\.([^.\[]*)(.*)")
EXAMPLE = "for example R: {value: 2.7, spread: 1.0}"


def write_out_spreads(source: Source) -> Source:
    """Return a system with the short forms of its parameters written out.

    A plain key has the location of what it stands for.

    Args:
        source: the system, as it is written.

    Raises:
        InputError: a short form has an unknown key or no value, or a spread is given twice.
    """
    where = where_in(source.lines)
    values = with_plain_parameters(source.values, where)
    stated = section_of(section_of(source.values, "system"), "parameter_spread")
    for name, entry in _short_forms(source.values).items():
        key = f"system.parameters.{name}"
        if "value" not in entry:
            raise InputError(f"{key} has no value", where=where(key), hint=EXAMPLE)
        if "spread" in entry and name in stated:
            what = f"the spread of {name} is given twice: here and in system.parameter_spread"
            raise InputError(what, where=where(f"{key}.spread"), hint="keep one of them")
    return Source(values, {plain_key(key, line): line for key, line in source.lines.items()})


def with_plain_parameters(values: dict[str, Any], where: Where) -> dict[str, Any]:
    """Return a layer of a configuration with the short forms of its parameters written out.

    Args:
        values: the layer. A short form overrides ``parameter_spread``.
        where: returns the location of a key.

    Raises:
        InputError: a short form has an unknown key.
    """
    short_forms = _short_forms(values)
    if not short_forms:
        return values
    system = values["system"]
    found: dict[str, dict[str, Any]] = {part: {} for part in SECTIONS}
    for name, given in system["parameters"].items():
        for part, value in short_forms.get(name, {"value": given}).items():
            key = f"system.parameters.{name}.{part}"
            _check_part(part, key, where(key))
            found[part][name] = value
    system = system | {"parameters": found.pop("value")}
    for part, given in found.items():
        stated = system.get(SECTIONS[part], {})
        # A value that is not a section is refused later.
        if given and isinstance(stated, dict):
            system[SECTIONS[part]] = stated | given
    return values | {"system": system}


def plain_key(key: str, where: str) -> str:
    """Return the plain key of a dotted key.

    That of ``system.parameters.R.spread`` is ``system.parameter_spread.R``.

    Args:
        key: any dotted key.
        where: its location.

    Raises:
        InputError: it is an unknown key of a short form.
    """
    parts = SHORT_KEY.fullmatch(key)
    if parts is None:
        return key
    name, part, rest = parts.groups()
    _check_part(part, key, where)
    return f"system.{SECTIONS[part]}.{name}{rest}"


def _check_part(part: str, key: str, where: str) -> None:
    if part not in SECTIONS:
        raise InputError(f"unknown key {key}", where=where, hint=nearest(part, SECTIONS))


def _short_forms(values: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the parameters that are sections of keys, by name."""
    parameters = section_of(section_of(values, "system"), "parameters")
    return {name: given for name, given in parameters.items() if isinstance(given, dict) and given}
