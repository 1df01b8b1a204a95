"""Units in the files of a recording are read and compared with the configuration."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dashred.core.errors import InputError
from dashred.data.io.reader import read_recording
from dashred.data.io.write_netcdf import write_netcdf
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor

ROWS = "".join(f"{i / 10},{i % 7},{i % 5}\n" for i in range(25))


def csv(header: str) -> str:
    return f"{header}\n{ROWS}"


def test_units_in_a_header_are_taken_up(ode, write) -> None:
    path = write("r.csv", csv("time [s],u [rad],v [rad s-1]"))
    recording = read_recording(path, None, ode)
    assert recording.names == ("u", "v")
    assert recording.units == {"t": "s", "u": "rad", "v": "rad s-1"}
    bare = read_recording(write("b.csv", csv("time,u,v")), None, ode)
    assert bare.units == {}
    np.testing.assert_array_equal(bare.values, recording.values)
    assert bare.sha256() != recording.sha256()


def test_a_unit_spelled_otherwise_is_the_same(ode, write) -> None:
    stated = dataclasses.replace(ode, units={"t": "s", "u": "rad", "v": "rad/s"})
    path = write("r.csv", csv("time [s],u [rad],v [rad s^-1]"))
    assert read_recording(path, None, stated).units["v"] == "rad s^-1"


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("time,u [deg],v", "r.csv:1, column 'u': sensor 'u' is in deg here, but in rad in conf"),
        ("time [ms],u,v", "r.csv:1, column 'time': time is in ms here, but in s in conf.yaml, sy"),
        ("time,u [],v", "r.csv:1: the unit of column 'u' is empty"),
        ("time,u [rad],u [deg]", "r.csv:1: 'u' occurs twice"),
    ],
)
def test_another_unit_than_the_configurations_is_refused(ode, write, header, message) -> None:
    stated = dataclasses.replace(ode, units={"t": "s", "u": "rad"})
    with pytest.raises(InputError) as error:
        read_recording(write("r.csv", csv(header)), None, stated)
    assert message in str(error.value)


def test_an_inputs_unit_is_held_against_the_configurations(ode, write) -> None:
    driven = dataclasses.replace(ode, inputs={"f": "drive"}, units={"f": "N"})
    path = write("r.csv", csv("time,u,drive [N]"))
    assert read_recording(path, None, driven).units == {"f": "N"}
    with pytest.raises(InputError, match=r"column 'drive': the input f is in V here, but in N in"):
        read_recording(write("r.csv", csv("time,u,drive [V]")), None, driven)


def test_the_table_of_sensors_states_units_too(ring, write) -> None:
    path = write("r.csv", csv("time,a,b"))
    table = write("s.csv", "name,field,x [m],std [K],unit\na,u,0.5,0.1,K\nb,u,1.5,0.1,\n")
    assert read_recording(path, table, ring).units == {"x": "m", "u": "K"}


@pytest.mark.parametrize(
    ("header", "table", "message"),
    [
        (
            "time,a [mV],b",
            "name,field,x,unit\na,u,0.5,K\nb,v,1.5,\n",
            "r.csv:1, column 'a': sensor 'a' is in mV here, but in K in {s}:2, column 'unit'",
        ),
        (
            "time,a,b",
            "name,field,x,unit\na,u,0.5,K\nb,u,1.5,degC\n",
            "s.csv:3, column 'unit': sensor 'b' is in degC here, but in K in {s}:2, column 'unit'",
        ),
        (
            "time,a,b",
            "name,field,x [cm]\na,u,0.5\nb,u,1.5\n",
            "s.csv:1, column 'x': x is in cm here, but in m in conf.yaml, system.units.x",
        ),
        (
            "time,a [K],b",
            "name,field,x,std [mK]\na,u,0.5,1\nb,v,1.5,1\n",
            "is in K here, but in mK in {s}:1, column 'std'",
        ),
    ],
)
def test_units_of_two_files_that_differ_are_refused(ring, write, header, table, message) -> None:
    stated = dataclasses.replace(ring, units={"x": "m"})
    path, sensors = write("r.csv", csv(header)), write("s.csv", table)
    with pytest.raises(InputError) as error:
        read_recording(path, sensors, stated)
    assert message.format(s=sensors) in str(error.value)


@pytest.fixture
def recording() -> Recording:
    sensors = (Sensor("a", "u", (0.5,)), Sensor("b", "v", (1.5,)))
    values = np.random.default_rng(0).normal(size=(30, 2))
    units = {"t": "s", "x": "m", "u": "K"}
    return Recording(sensors, np.arange(30.0), values, units=units)


def test_netcdf_keeps_units(ring, recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "r.nc"
    write_netcdf(recording, path, ["x"])
    read = read_recording(str(path), None, ring)
    assert read.units == recording.units
    assert read.sha256() == recording.sha256()


@pytest.mark.parametrize(
    ("name", "unit", "message"),
    [
        ("time", "hours since 2020-01-01", "'time': time is in hours here, but in s in conf.yaml"),
        ("x", "km", "'x': x is in km here, but in m in conf.yaml, system.units.x"),
        ("value", "mK", "sensor 'a' is in K here, but in mK in"),
    ],
)
def test_netcdf_with_another_unit_is_refused(
    ring, recording: Recording, tmp_path: Path, name, unit, message
) -> None:
    path = tmp_path / "r.nc"
    write_netcdf(recording, path, ["x"])
    dataset = xr.load_dataset(path, engine="h5netcdf", decode_times=False)
    dataset[name].attrs["units"] = unit
    other = tmp_path / "other.nc"
    dataset.to_netcdf(other, engine="h5netcdf")
    stated = dataclasses.replace(ring, units={"t": "s", "x": "m"})
    with pytest.raises(InputError) as error:
        read_recording(str(other), None, stated)
    assert message in str(error.value)
