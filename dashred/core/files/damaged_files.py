"""Files in formats of many layers, each of which fails on damage in its own way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from dashred.core.errors import InputError
from dashred.core.system_errors import describe


@contextmanager
def reading(kind: str, path: str, hint: str | None = None) -> Iterator[None]:
    """Say of whatever goes wrong inside that the file is not readable.

    What is no fault of the file goes through as it is: a package that is not installed, a disk that
    fails, a right that is missing.

    Args:
        kind: of file, in words.
        path: as the user names it.
        hint: what such a file has to be.

    Raises:
        InputError: it is damaged, or something else than was expected.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        if isinstance(error, ImportError | OSError) and describe(error):
            raise
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"not a readable {kind}: {reason}", where=path, hint=hint) from error
