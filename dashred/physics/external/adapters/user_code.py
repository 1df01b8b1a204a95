"""Import of a user's code, and what it says when it fails."""

from __future__ import annotations

import sys
import traceback
from importlib import import_module
from pathlib import Path
from typing import Any

from dashred.physics.external.trust import check_trusted

# Code of libraries and of dashred: an error is reported at the user's own line that led there.
OTHERS = ("site-packages", "dist-packages", "lib/python", "<frozen", str(Path(__file__).parents[3]))


def load(name: str, place: str) -> Any:
    """Import ``MODULE.ATTRIBUTE``, also from the current folder.

    Raises:
        InputError: this process was not told to trust it.
        Exception: whatever the user's module raises.
    """
    check_trusted(name, place)
    module, _, attribute = name.rpartition(".")
    here = str(Path.cwd())
    if here not in sys.path:
        # Last, so that other files in this folder do not hide installed modules.
        sys.path.append(here)
    return getattr(import_module(module), attribute)


def last_words(error: BaseException) -> str:
    """Return type, message and place of an exception: ``KeyError: 'v' (my.py:17)``."""
    lines = str(error).strip().splitlines()
    text = f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__
    return text + place_of(error)


def place_of(error: BaseException) -> str:
    """Return `` (my.py:17)``, the user's own line that led to an exception; empty without one."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not any(part in frame.filename for part in OTHERS)]
    return f" ({own[-1].filename}:{own[-1].lineno})" if own else ""
