"""Snapshots of a black-box simulator: what is read, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
import xarray as xr

from dashred.config import Axis, Integrator
from dashred.config import System as Declared
from dashred.core.errors import InputError
from dashred.physics.black_box.snapshot_file import open_snapshots
from dashred.physics.black_box.snapshot_reader import SnapshotReader
from dashred.physics.black_box.snapshots import Snapshots
from dashred.physics.runs.stored_states import StoredStates
from dashred.physics.system import System

Change = Callable[[xr.Dataset], xr.Dataset]
SHAPE = (3, 21, 8)


def declared(ends: str = "periodic", fields: tuple[str, ...] = ("u",)) -> System:
    integrator = Integrator(None, None, False, "spectral", 1e-9, 1e-9)
    axes = {"x": Axis(4.0, 8, ends)}
    meanings = dict.fromkeys(fields, "a field")
    return System(
        Declared(title="T", axes=axes, fields=meanings, integrator=integrator), lambda key: key
    )


def dataset(shape: tuple[int, ...] = SHAPE) -> xr.Dataset:
    values = np.random.default_rng(0).standard_normal(shape)
    coordinates = {"time": 2.0 + 0.1 * np.arange(shape[1]), "x": 0.5 * np.arange(shape[2])}
    return xr.Dataset({"u": (("member", "time", "x"), values)}, coordinates)


def written(folder: Path, data: xr.Dataset, name: str = "runs.nc") -> str:
    path = folder / name
    if name.endswith(".zarr"):
        data.to_zarr(path, zarr_format=2)
    else:
        data.to_netcdf(path, engine="h5netcdf")
    return str(path)


@pytest.mark.parametrize("name", ["runs.nc", "runs.zarr"])
def test_both_formats_give_the_same_states(tmp_path: Path, name: str) -> None:
    data = dataset()
    snapshots = open_snapshots(written(tmp_path, data, name), declared())
    assert (snapshots.members, snapshots.samples) == (3, 21)
    assert snapshots.step == pytest.approx(0.1)
    states, sha256 = snapshots.read(3, 0.2, np.random.default_rng(1))
    order = np.random.default_rng(1).permutation(3)
    expected = data["u"].values[order][:, ::2]
    np.testing.assert_array_equal(states[:, :, 0].numpy(), expected)
    assert states.dtype == torch.float64 and len(sha256) == 64


def test_nothing_is_read_before_it_is_asked_for(tmp_path: Path) -> None:
    """A value that is not finite is met in a run that is read, and in no other."""
    data = dataset()
    data["u"][2, 4, 5] = np.nan
    snapshots = open_snapshots(written(tmp_path, data), declared())
    without = next(seed for seed in range(99) if permuted(seed)[0] != 2)
    snapshots.read(1, 0.1, np.random.default_rng(without))
    with pytest.raises(InputError, match=r"u is not finite in member 2, sample 4"):
        snapshots.read(3, 0.1, np.random.default_rng(0))


def permuted(seed: int) -> list[int]:
    return [int(member) for member in np.random.default_rng(seed).permutation(3)]


def test_a_file_without_members_holds_one_run_and_dimensions_may_stand_in_any_order(
    tmp_path: Path,
) -> None:
    one = dataset().isel(member=0).transpose("x", "time")
    snapshots = open_snapshots(written(tmp_path, one), declared())
    states, _ = snapshots.read(5, 0.1, np.random.default_rng(0))
    np.testing.assert_array_equal(states[0, :, 0].numpy(), one["u"].values.T)


def test_an_axis_with_ends_is_mirrored(tmp_path: Path) -> None:
    data = dataset((2, 21, 9))
    path = written(tmp_path, data)
    states, _ = open_snapshots(path, declared("insulated")).read(2, 0.1, np.random.default_rng(0))
    assert states.shape == (2, 21, 1, 16)
    torch.testing.assert_close(states[..., 9:], states[..., 1:8].flip(-1))


@pytest.mark.parametrize("name", ["runs.nc", "runs.zarr"])
@pytest.mark.parametrize("ends", ["periodic", "insulated"])
def test_runs_that_are_read_in_parts_are_those_that_are_read_at_once(
    tmp_path: Path, name: str, ends: str
) -> None:
    data = dataset((3, 21, 8 if ends == "periodic" else 9))
    snapshots = open_snapshots(written(tmp_path, data, name), declared(ends))
    states, sha256 = snapshots.read(2, 0.2, np.random.default_rng(1))
    reader = SnapshotReader.of(snapshots, 2, 0.2, np.random.default_rng(1))
    assert reader.shape == tuple(states.shape) and 1 <= reader.chunk <= 21
    assert reader.sha256() == sha256
    stored = StoredStates(reader, range(2))
    assert torch.equal(stored[:, :], states)
    assert torch.equal(stored[1, 3:9], states[1, 3:9])


def test_a_value_that_is_not_finite_is_named_when_its_part_is_read(tmp_path: Path) -> None:
    data = dataset()
    data["u"][2, 4, 5] = np.nan
    snapshots = open_snapshots(written(tmp_path, data), declared())
    reader = SnapshotReader.of(snapshots, 3, 0.2, np.random.default_rng(0))
    row = permuted(0).index(2)
    assert reader.read(row, 3, 11).isfinite().all()
    with pytest.raises(InputError, match=r"u is not finite in member 2, sample 4 \(counted"):
        reader.read(row, 1, 4)
    with pytest.raises(InputError, match=r"u is not finite in member 2, sample 4 \(counted"):
        reader.sha256()


@pytest.mark.parametrize("version", [2, 3])
def test_a_zarr_folder_with_missing_chunks_is_refused(tmp_path: Path, version: int) -> None:
    """Zarr would read them as zeros."""
    data, path = dataset().chunk({"member": 1}), tmp_path / "runs.zarr"
    data.to_zarr(path, zarr_format=version, consolidated=version == 2)
    assert open_snapshots(str(path), declared()).members == 3
    first = path / "u" / ("1.0.0" if version == 2 else "c/1/0/0")
    first.unlink()
    with pytest.raises(InputError, match="1 of 3 chunks of 'u' are missing") as error:
        open_snapshots(str(path), declared())
    assert error.value.where == str(path) and "write_empty_chunks" in str(error.value.hint)


REFUSED: dict[str, tuple[Change, str]] = {
    "field": (lambda d: d.rename(u="U"), "no variable 'u'"),
    "dimensions": (
        lambda d: d.rename(x="y"),
        r"\(member, time, y\) instead of \(member, time, x\)",
    ),
    "no time": (lambda d: d.drop_vars("time"), "no coordinate 'time'"),
    "uneven": (
        lambda d: d.assign_coords(time=2.0 + 0.1 * np.arange(21) ** 1.2),
        "'time' is uneven",
    ),
    "backwards": (lambda d: d.isel(time=slice(None, None, -1)), "'time' is uneven"),
    "points": (lambda d: d.isel(x=slice(0, 6)), "6 points along x, but the grid has 8"),
    "no coordinate": (lambda d: d.assign_coords(x=np.full(8, np.nan)), r"x \(nan to nan\)"),
    "coordinate": (lambda d: d.assign_coords(x=np.arange(8.0)), r"coordinate x \(0 to 7\)"),
    "text": (lambda d: d.assign(u=d["u"].astype(str)), "does not hold numbers"),
    "one snapshot": (lambda d: d.isel(time=[0]), "at least two snapshots"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_is_refused(tmp_path: Path, case: str) -> None:
    change, message = REFUSED[case]
    path = written(tmp_path, change(dataset()))
    with pytest.raises(InputError, match=message) as error:
        open_snapshots(path, declared())
    assert error.value.where == path


@pytest.mark.parametrize("name", ["absent.nc", "broken.nc", "empty.zarr"])
def test_what_cannot_be_opened_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "broken.nc").write_bytes(b"this is no NetCDF")
    (tmp_path / "empty.zarr").mkdir()
    with pytest.raises(InputError, match=r"no such file|not a readable"):
        open_snapshots(str(tmp_path / name), declared())


def test_values_that_are_damaged_are_told_of_the_file(tmp_path: Path) -> None:
    """Only when they are read: the file opens."""
    path = written(tmp_path, dataset(), "runs.zarr")
    for chunk in (tmp_path / "runs.zarr" / "u").glob("*.*.*"):
        chunk.write_bytes(b"")
    snapshots = open_snapshots(path, declared())
    with pytest.raises(InputError, match="not a readable file of snapshots") as error:
        snapshots.read(3, 0.2, np.random.default_rng(1))
    assert error.value.where == path and "write it again" in str(error.value.hint)


def test_times_of_single_precision_are_even(tmp_path: Path) -> None:
    data = dataset((2, 2000, 8))
    data = data.assign_coords(time=data["time"].astype(np.float32))
    snapshots = open_snapshots(written(tmp_path, data), declared())
    assert snapshots.step == pytest.approx(0.1, rel=1e-5)


@pytest.fixture
def tenth(tmp_path: Path) -> Snapshots:
    return open_snapshots(written(tmp_path, dataset()), declared())


def test_the_clock_has_a_whole_number_of_snapshots_a_step(tenth: Snapshots) -> None:
    assert tenth.clock_step(0.1, None) == pytest.approx(0.1)
    assert tenth.clock_step(0.02, None) == pytest.approx(0.1)
    assert tenth.clock_step(0.25, None) == pytest.approx(0.3)
    assert tenth.clock_step(0.05, 0.2) == 0.2
    with pytest.raises(InputError, match="not a multiple of the snapshots' step") as error:
        tenth.clock_step(0.05, 0.15)
    assert error.value.where == "recording.every"
