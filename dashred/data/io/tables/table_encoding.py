"""The encoding of a table that is not UTF-8: spreadsheets write UTF-16 and Windows-1252."""

from __future__ import annotations

import codecs
from pathlib import Path

from dashred.core.errors import InputError

MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def other_encoding(path: str) -> str:
    """Return the encoding of a file that is not UTF-8.

    It is UTF-16 if the file begins with its mark. Otherwise it is Windows-1252, which agrees with
    UTF-8 in all digits and separators: only letters such as é in a name could be others.

    Raises:
        InputError: the file is no text in these encodings.
    """
    data = Path(path).read_bytes()
    encoding = "utf-16" if data.startswith(MARKS) else "cp1252"
    try:
        is_text = "\0" not in data.decode(encoding)
    except UnicodeDecodeError:
        is_text = False
    if is_text:
        return encoding
    hint = "save the table as CSV in UTF-8"
    raise InputError("not UTF-8 text", where=f"{path}:{_first_line(data)}", hint=hint)


def _first_line(data: bytes) -> int:
    """Return the line of the first byte that is not UTF-8."""
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        return data.count(b"\n", 0, error.start) + 1
    return 1
