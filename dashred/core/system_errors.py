"""What the machine may refuse in the middle of a run, told in one sentence instead of a traceback.

A full disk, a folder that cannot be written to, too little memory, a database that somebody holds
or a package that is not installed is nobody's mistake in the input, and nothing that a traceback
would help with.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from types import TracebackType

OURS = frozenset({"dashred", "datamodules", "callbacks"})
SPACE = "make room there, or write elsewhere: output=DIR tracking.root=DIR"
RIGHTS = "give yourself the right to write there, or write elsewhere: output=DIR tracking.root=DIR"
READING = "give yourself the right to read it"
MEMORY = "close other programs, or ask for less: axes' points, simulation.members, threads"
LOCKED = "end what else is using the MLflow store, or choose another: tracking.root=DIR"
INSTALL = "`make setup` installs what is needed in a checkout; elsewhere: pip install dashred"
HINTS = {
    errno.ENOSPC: SPACE,
    errno.EDQUOT: SPACE,
    errno.EFBIG: SPACE,
    errno.EROFS: RIGHTS,
    errno.EACCES: RIGHTS,
    errno.EPERM: RIGHTS,
    errno.EIO: "the disk reports a fault of its own; write elsewhere: output=DIR tracking.root=DIR",
    errno.ENOMEM: MEMORY,
    errno.EMFILE: "raise the limit of open files: ulimit -n 4096",
}
# SQLite reaches us through SQLAlchemy and MLflow, as the words of its message alone.
DATABASE = {
    "database is locked": LOCKED,
    "database or disk is full": SPACE,
    "readonly database": RIGHTS,
    "disk I/O error": SPACE,
    "unable to open database file": RIGHTS,
    "database disk image is malformed": "the store is damaged; choose another: tracking.root=DIR",
}
# torch gives a failed allocation no type of its own.
NO_MEMORY = ("can't allocate memory", "not enough memory", "out of memory")


class RefusedError(Exception):
    """What a program beside ours refuses in the middle of a run, in words for the user."""


def describe(error: BaseException) -> str | None:
    """Return what the machine has refused and what to do; None where it is a failure of ours."""
    if said := _package(error):
        return said
    for cause in _causes(error):
        if isinstance(cause, RefusedError):
            return str(cause)
        if said := _memory(cause) or _system(cause) or _database(cause):
            return said
    return None


def tell_uncaught(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print what ended the process: as ``sys.excepthook`` does, or what :func:`describe` says."""
    if said := describe(error):
        print(f"error: {said}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


def _causes(error: BaseException) -> Iterator[BaseException]:
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
    if not name or name in OURS:
        return None
    return f"the package {name} cannot be imported: {_first_line(error)}\n  {INSTALL}"


def _memory(error: BaseException) -> str | None:
    short = isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and any(said in str(error) for said in NO_MEMORY)
    )
    return f"there is not enough memory: {_first_line(error)}\n  {MEMORY}" if short else None


def _system(error: BaseException) -> str | None:
    if not isinstance(error, OSError) or error.errno not in HINTS:
        return None
    place = f"{error.filename}: " if error.filename else ""
    # HDF5 writes a page where the system has a phrase.
    return f"{place}{os.strerror(error.errno)}\n  {_hint(error)}"


def _hint(error: OSError) -> str:
    hint, place = HINTS[error.errno or 0], error.filename
    unread = hint == RIGHTS and os.path.exists(place or "") and not os.access(place, os.R_OK)
    return READING if unread else hint


def _database(error: BaseException) -> str | None:
    text = str(error)
    for said, hint in DATABASE.items():
        if said in text:
            return f"the MLflow store cannot be used: {said}\n  {hint}"
    return None


def _first_line(error: BaseException) -> str:
    return next(iter(str(error).splitlines()), "") or type(error).__name__
