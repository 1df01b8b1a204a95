"""Removal of entries of a system's file on the command line: ``system.inputs.e=~``."""

from __future__ import annotations

from typing import Any

from dashred.config.source import Source, section_of
from dashred.core.errors import InputError, nearest

REMOVED = ("~", None)
# Sections whose names the system's file defines.
SECTIONS = (
    "fields",
    "parameters",
    "parameter_spread",
    "parameter_per",
    "tables",
    "let",
    "equations",
    "start",
    "spread",
    "inputs",
    "units",
)


def remove_entries(written: Source, overrides: Source) -> tuple[Source, Source]:
    """Return a system without the entries that the overrides remove, and the other overrides.

    The spread of a removed parameter is removed, too.

    Args:
        written: the system.
        overrides: with ``~`` or null for an entry to remove.

    Raises:
        InputError: the system does not have such an entry.
    """
    entries, others = section_of(written.values, "system"), section_of(overrides.values, "system")
    keys: list[str] = []
    for section in SECTIONS:
        values, known = section_of(others, section), section_of(entries, section)
        removed = [name for name, value in values.items() if value in REMOVED]
        for name in removed:
            if name not in known:
                what, hint = f"system.{section} has no {name} to remove", nearest(name, known)
                raise InputError(what, where=overrides.lines[""], hint=hint)
        if removed:
            entries[section] = _without(known, removed)
            others[section] = _without(values, removed)
        keys += [f"system.{section}.{name}" for name in removed]
        for beside in ("parameter_spread", "parameter_per") if section == "parameters" else ():
            if own := section_of(entries, beside):
                entries[beside] = _without(own, removed)
                keys += [f"system.{beside}.{name}" for name in removed]
    return _with_system(written, entries, keys), _with_system(overrides, others, keys)


def _without(entries: dict[str, Any], removed: list[str]) -> dict[str, Any]:
    return {name: value for name, value in entries.items() if name not in removed}


def _with_system(source: Source, system: dict[str, Any], removed: list[str]) -> Source:
    """Return a layer with another section ``system``, without the locations of removed keys."""
    if not system:
        return source
    lines = {
        key: line
        for key, line in source.lines.items()
        if not any(key == each or key.startswith((f"{each}.", f"{each}[")) for each in removed)
    }
    return Source(source.values | {"system": system}, lines)
