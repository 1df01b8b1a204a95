"""One-sentence descriptions of system errors, printed instead of a traceback.

A full disk, a read-only folder, too little memory, a locked database or a missing package is
neither an input error nor a bug, and a traceback would not help the user.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from types import TracebackType

OWN_PACKAGES = frozenset({"dashred", "datamodules", "callbacks"})
FREE_SPACE = "free some space there, or write elsewhere: output=DIR tracking.root=DIR"
WRITE_PERMISSION = "grant write permission there, or write elsewhere: output=DIR tracking.root=DIR"
READ_PERMISSION = "grant read permission"
MEMORY = (
    "close other programs, keep a large ensemble on disk, simulation.memory='2 GiB', or reduce the "
    "axes' points or threads"
)
LOCKED = "end the process that uses the MLflow store, or choose another: tracking.root=DIR"
INSTALL = "`make setup` installs what is needed in a checkout; elsewhere: pip install dashred"
HINTS = {
    errno.ENOSPC: FREE_SPACE,
    errno.EDQUOT: FREE_SPACE,
    errno.EFBIG: FREE_SPACE,
    errno.EROFS: WRITE_PERMISSION,
    errno.EACCES: WRITE_PERMISSION,
    errno.EPERM: WRITE_PERMISSION,
    errno.EIO: "the disk reports a hardware error; write elsewhere: output=DIR tracking.root=DIR",
    errno.ENOMEM: MEMORY,
    errno.EMFILE: "raise the limit on open files: ulimit -n 4096",
}
# SQLAlchemy and MLflow pass on the message of an SQLite error, but not its type.
DATABASE = {
    "database is locked": LOCKED,
    "database or disk is full": FREE_SPACE,
    "readonly database": WRITE_PERMISSION,
    "disk I/O error": FREE_SPACE,
    "unable to open database file": WRITE_PERMISSION,
    "database disk image is malformed": "the store is damaged; choose another: tracking.root=DIR",
}
# torch raises a plain RuntimeError for a failed allocation.
NO_MEMORY = ("can't allocate memory", "not enough memory", "out of memory")


class ExternalServiceError(Exception):
    """Failure of an external service during a run; the message is written for the user."""


def describe_system_error(error: BaseException) -> str | None:
    """Return a description of a system error with a hint, or None if the error is a bug."""
    if message := _package(error):
        return message
    for cause in causes(error):
        if isinstance(cause, ExternalServiceError):
            return str(cause)
        if message := _memory(cause) or _system(cause) or _database(cause):
            return message
    return None


def report_uncaught(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print an uncaught exception: a ``sys.excepthook`` that describes system errors."""
    if message := describe_system_error(error):
        print(f"error: {message}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def causes(error: BaseException) -> Iterator[BaseException]:
    """Yield an error, and the errors that it was raised from or after."""
    cause: BaseException | None = error
    seen: set[int] = set()
    while cause is not None and id(cause) not in seen:
        seen.add(id(cause))
        yield cause
        cause = cause.__cause__ or cause.__context__


def _package(error: BaseException) -> str | None:
    if not isinstance(error, ImportError):
        return None
    name = (error.name or "").partition(".")[0]
    if not name or name in OWN_PACKAGES:
        return None
    return f"the package {name} cannot be imported: {_first_line(error)}\n  {INSTALL}"


def _memory(error: BaseException) -> str | None:
    short = isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and any(text in str(error) for text in NO_MEMORY)
    )
    return f"there is not enough memory: {_first_line(error)}\n  {MEMORY}" if short else None


def _system(error: BaseException) -> str | None:
    if not isinstance(error, OSError) or error.errno not in HINTS:
        return None
    place = f"{error.filename}: " if error.filename else ""
    # os.strerror is one phrase; HDF5's own message is a page.
    return f"{place}{os.strerror(error.errno)}\n  {_hint(error)}"


def _hint(error: OSError) -> str:
    hint, place = HINTS[error.errno or 0], error.filename
    exists = hint == WRITE_PERMISSION and os.path.exists(place or "")
    return READ_PERMISSION if exists and not os.access(place, os.R_OK) else hint


def _database(error: BaseException) -> str | None:
    text = str(error)
    for message, hint in DATABASE.items():
        if message in text:
            return f"the MLflow store cannot be used: {message}\n  {hint}"
    return None


def _first_line(error: BaseException) -> str:
    return next(iter(str(error).splitlines()), "") or type(error).__name__
