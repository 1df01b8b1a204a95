"""Compiled kernels that are kept on this machine for the next run.

A kernel of 65 terms takes three seconds to compile, and a run needs several of them. Numba keeps
the machine code of a function beside the file that defines it. The code here is generated, so each
kernel gets a file of its own, named by a hash of everything that the machine code depends on.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numba
from platformdirs import user_cache_path

from dashred.core.files.atomic import write_text_atomic

# The oldest kernels are deleted beyond this number. One takes 0.1 to 1 MB.
MOST_KERNELS = 200

_folder: Path | None = None


@contextmanager
def kernels_kept(folder: Path | None = None) -> Iterator[None]:
    """Keep the kernels that are compiled meanwhile.

    Only analyses do so. They do not know the truth of a concealed case, so it is never in the
    cache.

    Args:
        folder: where kernels are kept; by default a folder in the user's cache.
    """
    global _folder
    before, _folder = _folder, folder or user_cache_path("dashred") / "kernels"
    try:
        yield
    finally:
        _folder = before


def file_of(source: str, options: str) -> Path | None:
    """Return the file beside which Numba keeps a kernel; None if none is kept.

    Args:
        source: source code of the kernel.
        options: how it is compiled.
    """
    if _folder is None:
        return None
    known = "\n".join([source, options, numba.__version__])
    path = _folder / f"{hashlib.sha256(known.encode()).hexdigest()[:32]}.py"
    try:
        if not path.is_file():
            _folder.mkdir(parents=True, exist_ok=True)
            _delete_oldest(_folder)
            write_text_atomic(path, source)
    except OSError:  # no permission or no space: the kernel is compiled in every run
        return None
    return path if os.access(_folder, os.W_OK) else None


def forget(path: Path) -> None:
    """Delete a kernel."""
    path.unlink(missing_ok=True)
    for kept in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
        kept.unlink(missing_ok=True)


def _delete_oldest(folder: Path) -> None:
    """Make room for another kernel."""
    kernels = sorted(folder.glob("*.py"), key=lambda path: path.stat().st_mtime)
    for path in kernels[: max(0, len(kernels) - MOST_KERNELS + 1)]:
        forget(path)
