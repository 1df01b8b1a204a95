"""Write the page of every key: ``python -m dashred.reference path=docs/config.md``."""

from __future__ import annotations

import sys

from dashred.config.reference import page
from dashred.core.errors import DONE, InputError, run_entry
from dashred.core.files.atomic import write_text_atomic
from dashred.core.files.user_path import user_path

USAGE = """\
usage: python -m dashred.reference [path=FILE.md]

Writes the page of every configuration key: meaning, type, limits, unit, default. Without path=
it is printed.
"""


def main(argv: list[str]) -> int:
    """Write the page, or print it."""
    if {"--help", "-h"} & set(argv):
        print(USAGE)
        return DONE
    if not argv:
        print(page())
        return DONE
    key, _, path = argv[0].partition("=")
    if len(argv) > 1 or key != "path" or not path:
        hint = "python -m dashred.reference path=docs/config.md"
        raise InputError("expected path=FILE.md alone", where="command line", hint=hint)
    try:
        write_text_atomic(user_path(path, "path="), page())
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", where=path) from None
    print(f"{path} is written")
    return DONE


if __name__ == "__main__":
    sys.exit(run_entry(main))
