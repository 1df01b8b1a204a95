"""The place of the measured figures in a page, between two marks."""

from __future__ import annotations

from pathlib import Path

from dashred.core.errors import InputError
from dashred.core.files.atomic import write_text_atomic

BEGIN = "<!-- dashred benchmark writes what follows -->"
END = "<!-- end of what dashred benchmark writes -->"
NEW_PAGE = f"# Performance\n\n{BEGIN}\n{END}\n"


def check_page(path: Path) -> None:
    """Check that the figures can be written into a page; a page that is missing is started.

    Raises:
        InputError: the page cannot be read or lacks the marks.
    """
    _parts(path)


def write_between_marks(path: Path, text: str) -> None:
    """Replace what is between the marks of a page.

    Raises:
        InputError: as :func:`check_page`.
    """
    before, after = _parts(path)
    write_text_atomic(path, f"{before}{BEGIN}\n\n{text.strip()}\n\n{END}{after}")


def _parts(path: Path) -> tuple[str, str]:
    """Return what stands before and after the marks."""
    if not path.parent.is_dir():
        raise InputError("there is no such folder", where=str(path.parent), hint="document=FILE")
    try:
        page = path.read_text(encoding="utf-8") if path.exists() else NEW_PAGE
    except (OSError, UnicodeDecodeError) as error:
        what = f"this page cannot be read: {error}"
        raise InputError(what, where=str(path), hint="choose another one: document=FILE") from None
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(
            "the page has no place for the figures",
            where=str(path),
            hint=f"put these two lines where they belong: {BEGIN} and {END}",
        )
    return before, after
