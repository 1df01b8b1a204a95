"""A process that has its imports done and waits for its words: ``python -m dashred.standby ENTRY``.

The processes of a twin experiment follow each other, and each spends seconds on imports: while
one works, the next gets ready. It knows nothing until it is told: one line of JSON on its stdin.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module

from dashred.errors import DONE, run_entry


def main(argv: list[str]) -> int:
    """Import an entry point, and whatever else is named, then run it on the words from stdin.

    Nothing is run, if stdin ends without a line.
    """
    entry, *others = argv
    for module in others:
        import_module(module)
    found = import_module(entry)
    line = sys.stdin.readline()
    return int(found.main(json.loads(line))) if line else DONE


if __name__ == "__main__":
    sys.exit(run_entry(main))
