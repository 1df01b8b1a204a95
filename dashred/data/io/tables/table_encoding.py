"""The encoding of a table that is not UTF-8: spreadsheets write UTF-16 and Windows-1252."""

from __future__ import annotations

import codecs
from pathlib import Path

from dashred.core.errors import InputError

MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
# Bytes at the beginning of a file that show whether it is binary.
BEGINNING = 4096


def refuse_binary(path: str) -> None:
    """Check that the beginning of a file has no zero byte, unless it is UTF-16.

    Raises:
        InputError: it has one.
    """
    with open(path, "rb") as file:
        beginning = file.read(BEGINNING)
    if b"\0" in beginning and not beginning.startswith(MARKS):
        hint = "save it as a table of text in UTF-8, such as CSV, or convert it to NetCDF (.nc)"
        raise InputError("this is a binary file, and no table of text", where=path, hint=hint)


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
