"""Lines of a first configuration that the user has not yet completed."""

from __future__ import annotations

from dashred.config import Config
from dashred.core.errors import InputError

# Marks such a line; the user removes the mark.
TO_DO = "TO DO"


def unfinished_lines(config: Config) -> dict[str, str]:
    """Return the comment after each mark, by ``FILE:LINE``.

    A line whose values are all overridden on the command line is complete.
    """
    if config.source is None:
        return {}
    label, found, used = config.where(""), {}, set(config.lines.values())
    for number, line in enumerate(config.source.read_text(encoding="utf-8-sig").splitlines(), 1):
        written, mark, comment = line.partition(f"# {TO_DO}:")
        if mark and written.strip() and f"{label}:{number}" in used:
            found[f"{label}:{number}"] = comment.strip()
    return found


def refuse_unfinished_lines(config: Config) -> None:
    """Check that no line is marked: an analysis would only return the guessed values.

    Raises:
        InputError: at the first marked line.
    """
    marked = unfinished_lines(config)
    if marked:
        where, comment = next(iter(marked.items()))
        more = f", and {len(marked) - 1} more such lines" if len(marked) > 1 else ""
        hint = f"fill it in and remove the mark '# {TO_DO}: …'{more}; check lists what is left"
        raise InputError(f"this line is still to do: {comment}", where=where, hint=hint)
