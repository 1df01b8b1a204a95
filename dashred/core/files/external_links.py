"""Refusal of data files that link to other files, which could be any file on this machine."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from dashred.core.errors import InputError

HINT = "write the values themselves into the file, as xarray's to_netcdf and to_zarr do"

CONVERT = 'convert it: nccopy -k nc4 OLD NEW, or xarray\'s to_netcdf(NEW, engine="h5netcdf")'


def check_hdf5(path: str) -> None:
    """Check the links and variables of an HDF5 file without reading any values.

    Raises:
        InputError: a link points to another file, the values of a variable are in another file,
            or the file is NetCDF-3.
        OSError: the file is not HDF5.
    """
    with open(path, "rb") as classic:
        if classic.read(3) == b"CDF":
            problem = "this is a classic NetCDF-3 file; NetCDF-4 is needed"
            raise InputError(problem, where=path, hint=CONVERT)
    # Imported here, because it takes a second.
    import h5py  # type: ignore[import-untyped]

    # HDF5 loses an exception raised by a visitor, but stops at a returned value.
    def check_link(name: str, link: Any) -> str | None:
        own = isinstance(link, h5py.HardLink | h5py.SoftLink)
        return None if own else f"{name!r} is a link to another file"

    def check_variable(name: str, item: Any) -> str | None:
        if not isinstance(item, h5py.Dataset):
            return None
        parts = item.virtual_sources() if item.is_virtual else []
        outside = item.external or any(part.file_name != "." for part in parts)
        return f"the values of {name!r} are in another file" if outside else None

    with h5py.File(path) as file:
        fault = file.visititems_links(check_link) or file.visititems(check_variable)
    if fault:
        raise InputError(fault, where=path, hint=HINT)


def check_folder(path: str) -> None:
    """Check the symbolic links in a Zarr folder.

    Raises:
        InputError: a link points outside the folder.
    """
    own = Path(path).resolve()
    for folder, folders, files in os.walk(own):
        for name in (*folders, *files):
            inside = Path(folder, name)
            if inside.is_symlink() and not inside.resolve().is_relative_to(own):
                what = f"{inside.relative_to(own)} links outside this folder"
                raise InputError(what, where=path, hint=HINT)
