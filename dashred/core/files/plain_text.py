"""Characters that are not allowed in names, titles and paths."""

from __future__ import annotations

from unicodedata import category


def first_unprintable(text: str) -> str | None:
    """Return the first character that is not allowed in user text, or None.

    These are control characters, except line break and tab, and lone surrogates: they control
    terminals, end paths or cannot be encoded.
    """
    found = (sign for sign in text if category(sign) in ("Cc", "Cs") and sign not in "\n\t")
    return next(found, None)
