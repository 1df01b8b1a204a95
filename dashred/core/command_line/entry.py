"""Run a command as a process, from its arguments to its exit code."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from dashred.core.errors import INTERRUPTED, OUR_FAILURE, WRONG_INPUT, InputError
from dashred.core.system_errors import describe_system_error


def run_entry(main: Callable[[list[str]], int]) -> int:
    """Run ``main`` on the command-line arguments and return the exit code of the process.

    An :class:`InputError` is printed to stderr without a traceback and gives 2. A system error,
    such as a full disk, is printed likewise and gives 1. Ctrl-C gives 130. If the reader of stdout
    has closed it, as ``head`` does, nothing is printed and the code is 1. Any other exception is a
    bug and propagates: Python prints the traceback and exits with 1.
    """
    # At exit Python would run a full garbage collection, which takes 2 s after an analysis.
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)
    try:
        try:
            return main(sys.argv[1:])
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # Python flushes the buffer again at exit: send the rest to the null device.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OUR_FAILURE
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return WRONG_INPUT
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if (said := describe_system_error(error)) is None:
            raise
        print(f"error: {said}", file=sys.stderr)
        return OUR_FAILURE


@contextmanager
def fast_imports() -> Iterator[None]:
    """Import modules without garbage collection, and leave their objects out of later collections.

    Collections take a fifth of the time of an import, and each later full collection would visit
    these objects again. All objects that are alive at the end of the block are left out, also those
    of the caller.
    """
    was_enabled, known = gc.isenabled(), len(sys.modules)
    gc.disable()
    try:
        yield
    finally:
        # If nothing was imported, this would only keep the garbage of earlier analyses.
        if len(sys.modules) > known:
            if gc.get_freeze_count():
                gc.collect()
            gc.freeze()
        if was_enabled:
            gc.enable()
