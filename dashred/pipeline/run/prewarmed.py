"""A process that imports its modules, then waits for its command line.

The processes of a twin experiment run one after another, and each needs seconds for its imports.
The next process imports while the current one runs. ``python -m dashred.pipeline.run.prewarmed
ENTRY MODULE...`` reads the arguments of ENTRY from stdin, as one line of JSON.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib import import_module
from threading import Thread

from dashred.core.command_line.entry import fast_imports, run_entry
from dashred.core.errors import DONE, OUR_FAILURE

WATCH_SECONDS = 0.5


def main(argv: list[str]) -> int:
    """Import an entry point and other modules, then run it on the arguments from stdin.

    Nothing is run if stdin ends without a line.
    """
    Thread(target=_exit_with_parent, args=(os.getppid(),), daemon=True).start()
    entry, *others = argv
    with fast_imports():
        for module in others:
            import_module(module)
        entry_module = import_module(entry)
    line = sys.stdin.readline()
    return int(entry_module.main(json.loads(line))) if line else DONE


def _exit_with_parent(parent: int) -> None:
    """End this process when its parent has died without ending it.

    Otherwise it could write to a folder in which the same command is running again.
    """
    while os.getppid() == parent:
        time.sleep(WATCH_SECONDS)
    os._exit(OUR_FAILURE)


if __name__ == "__main__":
    sys.exit(run_entry(main))
