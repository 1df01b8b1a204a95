"""Recordings in NetCDF: the round trip, atomic writing, and damaged files."""

from __future__ import annotations

import gc
import os
import re
from dataclasses import replace

import h5py  # type: ignore[import-untyped]
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dashred.core.errors import InputError
from dashred.data.io.reader import read_recording
from dashred.data.io.write_netcdf import write_netcdf
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor

names = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=1)
values = st.one_of(st.floats(-1e100, 1e100), st.just(float("nan")))


@st.composite
def contents(draw):
    named = draw(
        st.lists(
            names.filter(lambda n: n != "time" and n != "episode"),
            min_size=1,
            max_size=4,
            unique=True,
        )
    )
    sensors = [
        (
            name,
            draw(st.sampled_from(["u", "v", "speed"])),
            (draw(st.floats(0, 2)),),
            draw(st.none() | st.floats(1e-300, 1e300)),
        )
        for name in named
    ]
    steps = draw(arrays(np.float64, 20, elements=st.floats(1e-3, 1e3)))
    table = draw(arrays(np.float64, (20, len(named)), elements=values))
    table[0] = 1.0
    return sensors, np.cumsum(steps), table


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(parts=contents())
def test_what_is_written_is_read(ring, tmp_path, parts):
    sensors, times, table = parts
    recording = Recording(tuple(Sensor(*sensor) for sensor in sensors), times, table)
    path = tmp_path / "r.nc"
    write_netcdf(recording, path)
    read = read_recording(str(path), None, ring)
    assert read.sensors == recording.sensors
    np.testing.assert_array_equal(read.times, recording.times)
    np.testing.assert_array_equal(read.values, recording.values)
    assert read.sha256() == recording.sha256()


def test_positions_go_by_the_names_of_the_axes(make_system, tmp_path):
    system = make_system(("r", 2.0, 8), ("phi", 3.0, 8))
    sensors = (Sensor("a", "u", (0.5, 2.5)), Sensor("b", "v", (1.5, 0.5), 0.1))
    recording = Recording(sensors, np.arange(20.0), np.ones((20, 2)))
    write_netcdf(recording, tmp_path / "r.nc", axes=("r", "phi"))
    assert read_recording(str(tmp_path / "r.nc"), None, system).sensors == sensors
    write_netcdf(recording, tmp_path / "xy.nc")
    with pytest.raises(InputError, match="no variable 'r'"):
        read_recording(str(tmp_path / "xy.nc"), None, system)


def test_regions_are_kept(ring, tmp_path):
    sensors = (Sensor("a", "u", (0.5,), widths=(0.25,)), Sensor("b", "v", (1.5,), 0.1))
    recording = Recording(sensors, np.arange(20.0), np.ones((20, 2)))
    write_netcdf(recording, tmp_path / "r.nc")
    read = read_recording(str(tmp_path / "r.nc"), None, ring)
    assert read.sensors[0] == sensors[0]
    assert read.sensors == sensors and read.sha256() == recording.sha256()
    points = replace(recording, sensors=(replace(sensors[0], widths=()), sensors[1]))
    assert points.sha256() != recording.sha256()


def test_an_ode_recording_has_no_coordinates(ode, tmp_path):
    recording = Recording((Sensor("u", "u"),), np.arange(20.0), np.ones((20, 1)))
    write_netcdf(recording, tmp_path / "r.nc")
    assert read_recording(str(tmp_path / "r.nc"), None, ode).sensors == recording.sensors


def test_equal_recordings_give_equal_bytes_and_cf_names(make_recording, tmp_path):
    for name in ("one.nc", "two.nc"):
        write_netcdf(make_recording(), tmp_path / name)
    assert (tmp_path / "one.nc").read_bytes() == (tmp_path / "two.nc").read_bytes()
    with xr.open_dataset(tmp_path / "one.nc", engine="h5netcdf") as dataset:
        assert dataset.attrs["featureType"] == "timeSeries"
        assert dataset["value"].dims == ("time", "sensor")
        assert dataset["name"].attrs["cf_role"] == "timeseries_id"


def test_a_failed_write_leaves_the_old_file_and_no_other(make_recording, tmp_path, monkeypatch):
    path = tmp_path / "r.nc"
    path.write_bytes(b"old")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_netcdf(make_recording(), path)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["r.nc"]


@pytest.fixture
def dataset(make_recording, tmp_path):
    write_netcdf(make_recording(3, 30), tmp_path / "r.nc")
    return xr.load_dataset(tmp_path / "r.nc", engine="h5netcdf")


def second_time_first(data):
    times = data["time"].values.copy()
    times[4] = times[2]
    return data.assign_coords(time=times)


def with_values(data, sample, sensor, value):
    changed = data["value"].values.copy()
    changed[sample, sensor] = value
    return data.assign(value=(("time", "sensor"), changed))


FAULTS = {
    "no value": (lambda d: d.drop_vars("value"), "no variable 'value'"),
    "no reads": (lambda d: d.drop_vars("reads"), "no variable 'reads'"),
    "no x": (lambda d: d.drop_vars("x"), "no variable 'x'"),
    "turned": (lambda d: d.assign(value=d["value"].T), "dimensions (sensor, time)"),
    "text": (lambda d: d.assign(value=d["value"].astype(str)), "does not hold numbers"),
    "unknown": (lambda d: d.assign(reads=d["reads"] + "q"), "reads 'uq'"),
    "same name": (lambda d: d.assign(name=("sensor", ["a", "a", "b"])), "'a' occurs twice"),
    "outside": (lambda d: d.assign(x=d["x"] + 1), "outside the axis"),
    "std": (lambda d: d.assign(std=d["std"].fillna(0)), "must be positive"),
    "short": (lambda d: d.isel(time=slice(7)), "7 samples are too few"),
    "back": (second_time_first, "sample 5, 'time': time decreases"),
    "infinite": (lambda d: with_values(d, 6, 1, np.inf), "sample 7, 's1': the value is infinite"),
    "silent": (lambda d: with_values(d, slice(None), 1, np.nan), "'s1' has no values"),
}


def test_the_noise_may_be_omitted(dataset, ring, tmp_path):
    path = tmp_path / "quiet.nc"
    dataset.drop_vars("std").to_netcdf(path, engine="h5netcdf")
    found = read_recording(str(path), None, ring)
    assert [sensor.std for sensor in found.sensors] == [None] * 3


@pytest.mark.parametrize("case", FAULTS)
def test_a_bad_recording_is_refused_where_it_is_bad(dataset, ring, tmp_path, case):
    spoil, message = FAULTS[case]
    path = tmp_path / "bad.nc"
    spoil(dataset).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(InputError) as caught:
        read_recording(str(path), None, ring)
    assert message in str(caught.value)


@pytest.mark.parametrize("length", [0, 1, 8, 100, 1000, 5000, 9000])
def test_a_damaged_file_is_refused(make_recording, ring, tmp_path, length):
    write_netcdf(make_recording(), tmp_path / "r.nc")
    whole = (tmp_path / "r.nc").read_bytes()
    assert length < len(whole)
    (tmp_path / "r.nc").write_bytes(whole[:length])
    with pytest.raises(InputError, match="not a readable NetCDF"):
        read_recording(str(tmp_path / "r.nc"), None, ring)


def test_a_damaged_object_leaves_no_traceback_behind(make_recording, ring, tmp_path, capfd):
    write_netcdf(make_recording(), tmp_path / "r.nc")
    whole = (tmp_path / "r.nc").read_bytes()
    headers = [match.start() for match in re.finditer(b"OHDR", whole)]
    assert len(headers) > 3
    for place in headers:
        damaged = whole[:place] + b"OHDX" + whole[place + 4 :]
        (tmp_path / "r.nc").write_bytes(damaged)
        with pytest.raises(InputError, match="not a readable NetCDF"):
            read_recording(str(tmp_path / "r.nc"), None, ring)
    gc.collect()
    assert capfd.readouterr().err == ""


def test_other_contents_and_a_missing_file_are_refused(ring, write, tmp_path):
    with pytest.raises(InputError, match="not a readable NetCDF"):
        read_recording(write("r.nc", "time,u\n0,1\n"), None, ring)
    with pytest.raises(InputError, match="no such file"):
        read_recording(str(tmp_path / "none.nc"), None, ring)


def test_a_table_beside_a_netcdf_is_refused(make_recording, ring, tmp_path):
    write_netcdf(make_recording(), tmp_path / "r.nc")
    with pytest.raises(InputError, match="describes its sensors itself"):
        read_recording(str(tmp_path / "r.nc"), "s.csv", ring)


@pytest.mark.parametrize("filling", [b" ", b"\0"])
def test_names_may_be_arrays_of_characters(dataset, ring, tmp_path, filling):
    """Names as CF and MATLAB write them: padded to one length, without an encoding."""
    changed = dataset.drop_vars(["name", "reads"])
    for name, texts in {"name": ["p0", "über", "p2"], "reads": ["u", "u", "v"]}.items():
        filled = [text.encode().ljust(7, filling) for text in texts]
        changed[name] = ("sensor", np.array(filled, "S7"))
    changed.to_netcdf(tmp_path / "r.nc", engine="h5netcdf")
    with h5py.File(tmp_path / "r.nc") as file:
        assert file["name"].shape == (3, 7) and "_Encoding" not in file["name"].attrs
    recording = read_recording(str(tmp_path / "r.nc"), None, ring)
    assert recording.names == ("p0", "über", "p2")
    assert [sensor.reads for sensor in recording.sensors] == ["u", "u", "v"]


@pytest.mark.parametrize("name", ["episode", "name"])
def test_text_that_is_not_utf_8_is_refused(dataset, ring, tmp_path, name):
    dim, count = ("time", 30) if name == "episode" else ("sensor", 3)
    changed = dataset.drop_vars("name") if name == "name" else dataset
    changed[name] = (dim, np.array([b"\xe9\xe9"] * count))
    changed.to_netcdf(tmp_path / "r.nc", engine="h5netcdf")
    with pytest.raises(InputError, match=f"'{name}' holds text that is not UTF-8"):
        read_recording(str(tmp_path / "r.nc"), None, ring)
