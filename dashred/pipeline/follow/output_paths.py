"""Checks of the files that are to be written, before anything is computed."""

from __future__ import annotations

from pathlib import Path

from dashred.core.errors import InputError

NETCDF, ZARR = ".nc", ".zarr"


def check_new(path: Path | None, name: str) -> None:
    """Check that an output can be created; an existing file is not overwritten.

    Raises:
        InputError: there is such a file, or no such folder.
    """
    if path is None:
        return
    if path.is_file() or path.is_dir():
        raise InputError("this exists already", where=str(path), hint=f"choose another {name}=")
    if not path.absolute().parent.is_dir():
        what = f"there is no folder {path.absolute().parent}"
        raise InputError(what, where=str(path), hint=f"create it, or choose another {name}=")


def check_ending(path: Path | None) -> None:
    """Check that fields can be written to a file of this ending.

    Raises:
        InputError: it is neither NetCDF nor Zarr.
    """
    if path is not None and path.suffix.lower() not in (NETCDF, ZARR):
        what = f"fields are written to {NETCDF} or {ZARR}, not {path.suffix or 'without an ending'}"
        raise InputError(what, where=str(path))
