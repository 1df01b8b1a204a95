"""The short forms of an uncertain parameter and of an uncertain start, written out.

``parameters: {R: {value: 2.7, spread: 1.0}}`` stands for the plain keys ``parameters: {R: 2.7}``
and ``parameter_spread: {R: 1.0}``; ``start: {q: {value: 1, spread: 0.1}}`` for ``start: {q: 1}``
and ``spread: {q: 0.1}``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from dashred.config.layers import where_in
from dashred.config.schema.types import Where
from dashred.config.source import Source, section_of
from dashred.core.errors import InputError, nearest

# The plain section of each key of a short form, by the section that it is written in.
SECTIONS = {
    "parameters": {"value": "parameters", "spread": "parameter_spread", "per": "parameter_per"},
    "start": {"value": "start", "spread": "spread"},
}
SHORT_KEY = re.compile(r"system\.(parameters|start)\.([^.\[]+)\.([^.\[]*)(.*)")
EXAMPLE = "for example R: {value: 2.7, spread: 1.0}"


def write_out_spreads(source: Source) -> Source:
    """Return a system with the short forms of its parameters and starts written out.

    A plain key has the location of what it stands for.

    Args:
        source: the system, as it is written.

    Raises:
        InputError: a short form has an unknown key or no value, or a spread is given twice.
    """
    where = where_in(source.lines)
    values = with_plain_parameters(source.values, where)
    system = section_of(source.values, "system")
    for section, name, entry in _short_forms(source.values):
        key = f"system.{section}.{name}"
        if "value" not in entry:
            raise InputError(f"{key} has no value", where=where(key), hint=EXAMPLE)
        plain = SECTIONS[section]["spread"]
        if "spread" in entry and name in section_of(system, plain):
            what = f"the spread of {name} is given twice: here and in system.{plain}"
            raise InputError(what, where=where(f"{key}.spread"), hint="keep one of them")
    return Source(values, {plain_key(key, line): line for key, line in source.lines.items()})


def with_plain_parameters(values: dict[str, Any], where: Where) -> dict[str, Any]:
    """Return a layer of a configuration with its short forms written out.

    Args:
        values: the layer. A short form overrides the plain section.
        where: returns the location of a key.

    Raises:
        InputError: a short form has an unknown key.
    """
    short_forms = [*_short_forms(values)]
    for section in dict.fromkeys(section for section, _, _ in short_forms):
        entries = {name: entry for of, name, entry in short_forms if of == section}
        plain = _written_out(values["system"], section, entries, where)
        values = values | {"system": plain}
    return values


def _written_out(
    system: dict[str, Any], section: str, short_forms: dict[str, dict[str, Any]], where: Where
) -> dict[str, Any]:
    """Return a system with the short forms of one section written out."""
    parts = SECTIONS[section]
    found: dict[str, dict[str, Any]] = {part: {} for part in parts}
    for name, given in system[section].items():
        for part, value in short_forms.get(name, {"value": given}).items():
            key = f"system.{section}.{name}.{part}"
            _check_part(part, parts, key, where(key))
            found[part][name] = value
    system = system | {section: found.pop("value")}
    for part, given in found.items():
        stated = system.get(parts[part], {})
        # A value that is not a section is refused later.
        if given and isinstance(stated, dict):
            system[parts[part]] = stated | given
    return system


def plain_key(key: str, where: str) -> str:
    """Return the plain key of a dotted key.

    That of ``system.parameters.R.spread`` is ``system.parameter_spread.R``.

    Args:
        key: any dotted key.
        where: its location.

    Raises:
        InputError: it is an unknown key of a short form.
    """
    found = SHORT_KEY.fullmatch(key)
    if found is None:
        return key
    section, name, part, rest = found.groups()
    parts = SECTIONS[section]
    _check_part(part, parts, key, where)
    return f"system.{parts[part]}.{name}{rest}"


def _check_part(part: str, parts: dict[str, str], key: str, where: str) -> None:
    if part not in parts:
        raise InputError(f"unknown key {key}", where=where, hint=nearest(part, parts))


def _short_forms(values: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield the section and the name of every entry that is a section of keys, and the entry."""
    system = section_of(values, "system")
    for section in SECTIONS:
        for name, given in section_of(system, section).items():
            if isinstance(given, dict) and given:
                yield section, name, given
