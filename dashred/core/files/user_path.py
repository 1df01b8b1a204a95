"""Paths and server addresses given by the user."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import urlsplit

from dashred.core.errors import InputError

SERVERS = ("http", "https")
FOLDER = "give the folder that holds mlflow.db, or the address of a server: http://HOST:5000"
PASSWORD = "log in with MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD instead"


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


def is_server(root: str) -> bool:
    """Return whether ``tracking.root`` is the address of a tracking server, not a folder."""
    return root.partition("://")[0] in SERVERS and "://" in root


def check_address(root: str, where: str) -> None:
    """Check that an address in ``tracking.root`` is the address of a server.

    Raises:
        InputError: it is not, or it contains a password: addresses are printed and stored.
    """
    if "://" not in root and not root.startswith("sqlite:"):
        return
    if not is_server(root):
        raise InputError("this is neither a folder nor a server", where=where, hint=FOLDER)
    try:
        address = urlsplit(root)
        usable = bool(address.hostname) and address.port != 0
    except ValueError:
        usable = False
    if not usable:
        raise InputError("this is not the address of a server", where=where, hint=FOLDER)
    if "@" in address.netloc:
        problem = "the address of a server must not contain a password"
        raise InputError(problem, where=where, hint=PASSWORD)
