"""Atomic writes: a file is written completely or not at all."""

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
    """Yield a temporary path beside ``path``, which replaces ``path`` on success.

    The file is synced to the disk before it is renamed, so that even a power failure leaves no
    partial file. After an exception, an existing file is unchanged and the temporary file is
    removed.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        _fsync(partial)
        partial.replace(path)
        _fsync(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def write_text_atomic(path: Path, text: str) -> None:
    """Write a text in UTF-8 atomically."""
    with atomic_file(path) as partial:
        partial.write_bytes(text.encode())


def write_netcdf_atomic(path: Path, dataset: xr.Dataset) -> None:
    """Write a dataset as NetCDF atomically.

    The file is built in memory, because HDF5 crashes if the disk fills up before the file is
    closed.
    """
    with atomic_file(path) as partial:
        partial.write_bytes(dataset.to_netcdf(engine="h5netcdf"))


def copy_atomic(source: Path, target: Path) -> None:
    """Copy a file atomically."""
    with atomic_file(target) as partial:
        shutil.copyfile(source, partial)


def clear_partial(folder: Path) -> None:
    """Remove the temporary files of processes that were killed while writing."""
    for partial in folder.glob(".*.partial"):
        partial.unlink(missing_ok=True)


def _fsync(path: Path) -> None:
    opened = os.open(path, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
