"""The lines of a first configuration that its user has yet to see to."""

from __future__ import annotations

from dashred.config import Config
from dashred.core.errors import InputError

# What marks such a line; the user takes it away.
TO_DO = "TO DO"


def open_lines(config: Config) -> dict[str, str]:
    """Return what stands behind the mark, by ``FILE:LINE``.

    A line of which every value is given on the command line is seen to.
    """
    if config.source is None:
        return {}
    label, found, used = config.where(""), {}, set(config.lines.values())
    for number, line in enumerate(config.source.read_text(encoding="utf-8-sig").splitlines(), 1):
        written, mark, comment = line.partition(f"# {TO_DO}:")
        if mark and written.strip() and f"{label}:{number}" in used:
            found[f"{label}:{number}"] = comment.strip()
    return found


def refuse_open_lines(config: Config) -> None:
    """Refuse to analyse what nobody has looked through: it would find what was guessed.

    Raises:
        InputError: at the first line that is marked.
    """
    marked = open_lines(config)
    if marked:
        where, says = next(iter(marked.items()))
        more = f", and {len(marked) - 1} more such lines" if len(marked) > 1 else ""
        hint = f"fill it in and take the mark '# {TO_DO}: …' away{more}; check lists what is left"
        raise InputError(f"this line is still to do: {says}", where=where, hint=hint)
