"""The words of a small command: ``path=FILE`` and a few others, each given once."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.core.errors import InputError, nearest

PLACE = "command line"


def read_path_words(
    argv: Sequence[str], keys: Sequence[str], question: str, example: str
) -> dict[str, str]:
    """Return the words by their keys.

    Args:
        argv: ``key=value`` each.
        keys: that are known, ``path`` among them.
        question: asked of who gives no path.
        example: a command that would do.

    Raises:
        InputError: a word that is none of these, or is given twice, or no path.
    """
    words: dict[str, str] = {}
    for word in argv:
        key, sign, text = word.partition("=")
        if not sign or not text:
            raise InputError(f"expected key=value, got {word!r}", where=PLACE, hint=example)
        if key not in keys:
            raise InputError(f"unknown key {key}", where=PLACE, hint=nearest(key, keys))
        if key in words:
            raise InputError(f"{key}= is given twice", where=PLACE)
        words[key] = text
    if "path" not in words:
        raise InputError(f"{question} path= is missing", where=PLACE, hint=example)
    return words
