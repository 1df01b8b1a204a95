"""Characters that no name, title or path of a user's may hold."""

from __future__ import annotations

from unicodedata import category


def unprintable(text: str) -> str | None:
    """Return the first character that steers terminals, ends paths or cannot be written; or None.

    These are the control characters but for the line break and the tab, and lone surrogates.
    """
    found = (sign for sign in text if category(sign) in ("Cc", "Cs") and sign not in "\n\t")
    return next(found, None)
