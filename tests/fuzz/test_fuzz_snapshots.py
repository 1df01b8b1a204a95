"""Arbitrary snapshot files: refused with a name, or read as finite runs on the grid."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import torch
import xarray as xr
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.physics.black_box.snapshot_file import open_snapshots
from tests.fuzz.examples import fuzzed
from tests.physics.black_box.test_snapshots import declared

RING = declared(fields=("u", "v"))
ORDERS = st.one_of(
    st.just(("member", "time", "x")),
    st.permutations(["time", "x"]),
    st.sampled_from([("time",), ("x", "member"), ("time", "x", "y"), ("member", "time", "x", "y")]),
)
KINDS = st.sampled_from(["f8", "f8", "f4", "i4", "u1", "bool", "S3"])
VALUES = st.sampled_from([0.5, 0.5, 0.5, 0.0, -1.0, np.nan, np.inf, 1e300])
A_FIELD = st.tuples(ORDERS, KINDS, VALUES, st.sampled_from(["", "m", "<b>"]))
A_SOUND_FIELD = st.tuples(
    st.sampled_from([("member", "time", "x"), ("x", "time", "member")]),
    st.sampled_from(["f8", "f4", "i4"]),
    st.sampled_from([0.5, -1.0, 1e30]),
    st.just(""),
)
# Most random files are refused at the first error; half of these have valid fields.
FIELDS = st.one_of(
    st.fixed_dictionaries({"u": A_FIELD}, optional={"v": A_FIELD}),
    st.fixed_dictionaries({"u": A_SOUND_FIELD, "v": A_SOUND_FIELD}),
)
EVEN = st.sampled_from([[0.0, 0.1, 0.2], [2.0, 2.1, 2.2], [-1e6, 0.0, 1e6]])
TIMES = st.one_of(
    EVEN,
    EVEN,
    st.sampled_from([None, [0.0, 0.1, 0.3], [0.0, 0.0, 0.0]]),
    st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=3, max_size=3),
)
PLACES = st.sampled_from([None, 0.5, 0.5, 0.51, np.nan])
DAMAGE = (
    st.none()
    | st.none()
    | st.tuples(st.integers(0, 9), st.integers(0, 400), st.binary(max_size=40))
)
SIZES = {"member": 2, "time": 3, "x": 8, "y": 2}


@fuzzed(
    25,
    4_000,
    fields=FIELDS,
    times=TIMES,
    places=PLACES,
    damage=DAMAGE,
    ending=st.sampled_from(["nc", "zarr"]),
)
def test_any_snapshots_are_refused_or_finite_runs(
    fields: dict[str, tuple[tuple[str, ...], str, float, str]],
    times: list[float] | None,
    places: float | None,
    damage: tuple[int, int, bytes] | None,
    ending: str,
) -> None:
    data = made(fields, times, places)
    path = written(data, f"a.{ending}")
    damaged(path, damage)
    try:
        snapshots = open_snapshots(str(path), RING)
        states, digest = snapshots.read(2, snapshots.step, np.random.default_rng(0))
    except InputError as error:
        assert f"a.{ending}" in str(error)
        return
    assert states.shape == (snapshots.members, 3, 2, 8) and len(digest) == 64
    assert torch.isfinite(states).all() and snapshots.step > 0
    if damage is None:
        order = np.random.default_rng(0).permutation(snapshots.members)
        runs = ("member",) if "member" in data.dims else ()
        for index, name in enumerate(("u", "v")):
            expected = data[name].transpose(*runs, "time", "x").values.reshape(-1, 3, 8)[order]
            np.testing.assert_array_equal(states[:, :, index].numpy(), expected)


def made(
    fields: dict[str, tuple[tuple[str, ...], str, float, str]],
    times: list[float] | None,
    places: float | None,
) -> xr.Dataset:
    variables = {}
    for name, (dims, kind, value, unit) in fields.items():
        shape = tuple(SIZES[dim] for dim in dims)
        # A number outside the range of its type becomes whatever NumPy makes of it.
        with np.errstate(all="ignore"):
            values = (value + 0.25 * np.arange(np.prod(shape)).reshape(shape)).astype(kind)
        variables[name] = (dims, values, {"units": unit} if unit else {})
    coordinates: dict[str, Any] = {}
    if times is not None:
        coordinates["time"] = times
    if places is not None:
        coordinates["x"] = places * np.arange(8)
    return xr.Dataset(variables, coordinates)


def written(data: xr.Dataset, name: str) -> Path:
    path = Path(name)
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    if path.suffix == ".zarr":
        data.to_zarr(path, zarr_format=2)
    else:
        data.to_netcdf(path, engine="h5netcdf")
    return path


def damaged(path: Path, damage: tuple[int, int, bytes] | None) -> None:
    """Overwrite a few bytes of a file, or truncate it."""
    if damage is None:
        return
    which, at, raw = damage
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    chosen = files[which % len(files)]
    whole = chosen.read_bytes()
    kept = whole[at + len(raw) :] if which % 2 else b""
    chosen.write_bytes(whole[:at] + raw + kept)
