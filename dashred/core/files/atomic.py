"""Files that are written whole or not at all, whatever ends the writing."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a place beside ``path`` to write to; what lies there in the end takes its name.

    The name changes hands when the bytes are on the disk: not even a power failure leaves half a
    file under it. After an exception nothing is left but what was there before.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        _to_disk(partial)
        partial.replace(path)
        _to_disk(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def write_text_atomic(path: Path, text: str) -> None:
    """Write a text in UTF-8, whole or not at all."""
    with atomic_file(path) as partial:
        partial.write_bytes(text.encode())


def write_netcdf_atomic(path: Path, dataset: xr.Dataset) -> None:
    """Write a dataset as NetCDF, whole or not at all.

    Its bytes are made in memory: HDF5 does not survive a disk that is full before a file is closed.
    """
    with atomic_file(path) as partial:
        partial.write_bytes(dataset.to_netcdf(engine="h5netcdf"))


def copy_atomic(source: Path, target: Path) -> None:
    """Copy a file, whole or not at all."""
    with atomic_file(target) as partial:
        shutil.copyfile(source, partial)


def clear_partial(folder: Path) -> None:
    """Take away what a process that was killed had not finished writing."""
    for partial in folder.glob(".*.partial"):
        partial.unlink(missing_ok=True)


def _to_disk(path: Path) -> None:
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
