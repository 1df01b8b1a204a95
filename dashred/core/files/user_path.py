"""The places that a user names, in a command or a configuration: paths, and a server's address."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import urlsplit

from dashred.core.errors import InputError

SERVERS = ("http", "https")
FOLDER = "give the folder that holds mlflow.db, or the address of a server: http://HOST:5000"
PASSWORD = "say who you are by MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD instead"


def user_path(text: str, where: str) -> Path:
    """Return the path that a user means; ``~`` is the home folder.

    Args:
        text: as it was given.
        where: it was.

    Raises:
        InputError: it begins with the home folder of nobody here, or no file can have this name.
    """
    try:
        path = Path(text).expanduser()
    except RuntimeError:
        raise InputError(f"there is no home folder for {text!r}", where=where) from None
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass  # What is to become of it tells whether that matters.
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        shown = text if len(text) <= 60 else f"{text[:60]}…"
        raise InputError(f"no file can be called {shown!r}: {reason}", where=where) from None
    return path


def is_server(root: str) -> bool:
    """Whether `tracking.root` is the address of a tracking server, and no folder."""
    return root.partition("://")[0] in SERVERS and "://" in root


def check_address(root: str, where: str) -> None:
    """Make sure that what looks like an address in `tracking.root` is one of a server.

    Raises:
        InputError: it is not, or it holds a password: addresses are printed, and kept in records.
    """
    if "://" not in root and not root.startswith("sqlite:"):
        return
    if not is_server(root):
        raise InputError("this is not where runs are kept", where=where, hint=FOLDER)
    try:
        address = urlsplit(root)
        usable = bool(address.hostname) and address.port != 0
    except ValueError:
        usable = False
    if not usable:
        raise InputError("this is no address of a server", where=where, hint=FOLDER)
    if "@" in address.netloc:
        raise InputError("a server's address may not hold a password", where=where, hint=PASSWORD)
