"""Data files that would have us read other files: a stranger's could name any on this machine."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from dashred.core.errors import InputError

HINT = "write the values themselves into the file, as xarray's to_netcdf and to_zarr do"

NEWER = 'convert it: nccopy -k nc4 OLD NEW, or xarray\'s to_netcdf(NEW, engine="h5netcdf")'


def check_hdf5(path: str) -> None:
    """Look through the links and variables of an HDF5 file; none of its values is read.

    Raises:
        InputError: a link leads to another file, or a variable's values lie in one; or the file is
            of the kind before HDF5.
        OSError: it is no HDF5 file.
    """
    with open(path, "rb") as classic:
        if classic.read(3) == b"CDF":
            raise InputError("this is NetCDF of the classic kind", where=path, hint=NEWER)
    # Imported late: a second, which reading a CSV need not wait for.
    import h5py  # type: ignore[import-untyped]

    # What a visitor raises is lost in HDF5; what it returns ends the visit.
    def of_link(name: str, link: Any) -> str | None:
        own = isinstance(link, h5py.HardLink | h5py.SoftLink)
        return None if own else f"{name!r} is a link to another file"

    def of_variable(name: str, item: Any) -> str | None:
        if not isinstance(item, h5py.Dataset):
            return None
        parts = item.virtual_sources() if item.is_virtual else []
        outside = item.external or any(part.file_name != "." for part in parts)
        return f"the values of {name!r} lie in another file" if outside else None

    with h5py.File(path) as file:
        fault = file.visititems_links(of_link) or file.visititems(of_variable)
    if fault:
        raise InputError(fault, where=path, hint=HINT)


def check_folder(path: str) -> None:
    """Look for symbolic links in a Zarr folder.

    Raises:
        InputError: one leads out of the folder.
    """
    own = Path(path).resolve()
    for folder, folders, files in os.walk(own):
        for name in (*folders, *files):
            inside = Path(folder, name)
            if inside.is_symlink() and not inside.resolve().is_relative_to(own):
                what = f"{inside.relative_to(own)} is a link out of this folder"
                raise InputError(what, where=path, hint=HINT)
