"""Names that are not in use."""

from __future__ import annotations

from collections.abc import Collection


def free_name(wanted: str, taken: Collection[str]) -> str:
    """Return a name that is not in use: the wanted one, with underscores if necessary."""
    while wanted in taken:
        wanted += "_"
    return wanted


def take_name(wanted: str, taken: set[str]) -> str:
    """Return a name that is not in use, and add it to those that are."""
    name = free_name(wanted, taken)
    taken.add(name)
    return name
