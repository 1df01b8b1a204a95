"""Conversion of errors from reading damaged files to InputError."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from dashred.core.errors import InputError
from dashred.core.system_errors import describe_system_error


@contextmanager
def reading_errors(kind: str, path: str, hint: str | None = None) -> Iterator[None]:
    """Convert any exception raised inside to an InputError: the file is not readable.

    Errors that are not caused by the file are not converted: a missing package, a disk error, a
    missing permission.

    Args:
        kind: description of the file type.
        path: as given by the user.
        hint: what a valid file looks like.

    Raises:
        InputError: the file is damaged or of another type.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        if isinstance(error, ImportError | OSError) and describe_system_error(error):
            raise
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"not a readable {kind}: {reason}", where=path, hint=hint) from error
