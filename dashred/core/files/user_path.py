"""Paths given by the user."""

from __future__ import annotations

import os
from pathlib import Path

from dashred.core.errors import InputError


def user_path(text: str, where: str) -> Path:
    """Return the path given by the user, with ``~`` expanded.

    Args:
        text: the path as text.
        where: location for error messages.

    Raises:
        InputError: the home folder does not exist, or no file can have this name.
    """
    try:
        path = Path(text).expanduser()
    except RuntimeError:
        raise InputError(f"there is no home folder for {text!r}", where=where) from None
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass  # Whether the file must exist depends on the caller.
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        shown = text if len(text) <= 60 else f"{text[:60]}…"
        raise InputError(f"{shown!r} is not a valid file name: {reason}", where=where) from None
    return path
