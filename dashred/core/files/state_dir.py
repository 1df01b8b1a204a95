"""The user's state folder, for files that belong to no store and no output folder."""

from __future__ import annotations

import os
from pathlib import Path

from dashred.core.errors import InputError


def state_folder(*names: str) -> Path:
    """Create and return a folder below ``$XDG_STATE_HOME/dashred``, readable by this user only.

    Raises:
        InputError: the folder cannot be created.
    """
    folder = state_path(*names)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"this folder cannot be created: {error.strerror}",
            where=str(folder),
            hint="choose another with the environment variable XDG_STATE_HOME",
        ) from None
    return folder


def state_path(*names: str) -> Path:
    """Return the path of a folder below ``$XDG_STATE_HOME/dashred``, which need not exist."""
    base = Path(os.environ.get("XDG_STATE_HOME") or "~/.local/state").expanduser() / "dashred"
    return base.joinpath(*names)
