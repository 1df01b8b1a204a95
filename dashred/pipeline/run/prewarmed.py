"""A process that imports its modules, then waits for its command line.

The processes of a twin experiment follow each other, and each needs seconds for its imports. While
one works, the next imports. ``python -m dashred.pipeline.run.prewarmed ENTRY MODULE...`` reads the
words of ENTRY's command line from stdin, as one line of JSON.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib import import_module
from threading import Thread

from dashred.core.errors import DONE, OUR_FAILURE, run_entry

WATCH_SECONDS = 0.5


def main(argv: list[str]) -> int:
    """Import an entry point, and whatever else is named, then run it on the words from stdin.

    Nothing is run, if stdin ends without a line.
    """
    Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    entry, *others = argv
    for module in others:
        import_module(module)
    found = import_module(entry)
    line = sys.stdin.readline()
    return int(found.main(json.loads(line))) if line else DONE


def _end_with(leader: int) -> None:
    """End this process when the one that started it is gone, killed before it could say so.

    Otherwise it would go on, and write to a folder where the same command is running again.
    """
    while os.getppid() == leader:
        time.sleep(WATCH_SECONDS)
    os._exit(OUR_FAILURE)


if __name__ == "__main__":
    sys.exit(run_entry(main))
