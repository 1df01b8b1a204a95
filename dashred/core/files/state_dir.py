"""The folder of this user on this machine for what is of no store and of no output."""

from __future__ import annotations

import os
from pathlib import Path

from dashred.core.errors import InputError


def state_folder(*names: str) -> Path:
    """Make and return a folder below ``$XDG_STATE_HOME/dashred``, for this user's eyes alone.

    Raises:
        InputError: it cannot be made.
    """
    base = Path(os.environ.get("XDG_STATE_HOME") or "~/.local/state").expanduser() / "dashred"
    folder = base.joinpath(*names)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"this folder cannot be made: {error.strerror}",
            where=str(folder),
            hint="choose another with the environment variable XDG_STATE_HOME",
        ) from None
    return folder
