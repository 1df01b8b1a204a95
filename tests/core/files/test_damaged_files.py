"""A damaged file is an input error; a missing package or a failing disk is not."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dashred.core.command_line.entry import run_entry
from dashred.core.errors import InputError
from dashred.core.files.damaged_files import reading_errors
from dashred.data.io.read_netcdf import read_netcdf
from dashred.physics.black_box.snapshot_file import open_snapshots
from tests import laws


def test_what_a_damaged_file_raises_is_told_of_the_file() -> None:
    damage = [KeyError("layout"), ValueError("bad\nand more"), OSError("truncated"), MemoryError()]
    for error in damage:
        readable = reading_errors("recording", "r.nc", "a hint")
        with pytest.raises(InputError, match="not a readable recording") as told, readable:
            raise error
        assert (told.value.where, told.value.hint) == ("r.nc", "a hint")
        assert "\n" not in str(told.value.args[0])


def test_what_is_wrong_in_it_stays_what_it_is() -> None:
    with pytest.raises(InputError, match="a link"), reading_errors("recording", "r.nc"):
        raise InputError("a link", where="r.nc")


def test_what_is_no_fault_of_the_file_goes_through() -> None:
    for error in (
        ModuleNotFoundError("No module named 'h5py'", name="h5py"),
        OSError(errno.EIO, os.strerror(errno.EIO), "r.nc"),
        PermissionError(errno.EACCES, os.strerror(errno.EACCES), "r.nc"),
    ):
        with pytest.raises(type(error)), reading_errors("recording", "r.nc"):
            raise error


@pytest.mark.parametrize("package", ["h5py", "h5netcdf", "zarr"])
def test_a_missing_package_is_named(
    package: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    system = laws.declared(tmp_path)
    given = xr.Dataset({"u": ("time", np.zeros(3))})
    path = tmp_path / ("run.zarr" if package == "zarr" else "run.nc")
    given.to_zarr(path, consolidated=False) if package == "zarr" else given.to_netcdf(
        path, engine="h5netcdf"
    )
    monkeypatch.setitem(sys.modules, package, None)

    def opened(_: list[str]) -> int:
        open_snapshots(str(path), system)
        return 0

    def read(_: list[str]) -> int:
        read_netcdf(str(path), system)
        return 0

    for entry in (opened, read) if package != "zarr" else (opened,):
        assert run_entry(entry) == 1
        said = capsys.readouterr().err
        assert f"the package {package} cannot be imported" in said and "make setup" in said
