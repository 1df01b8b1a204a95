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
        ("time,u [m],v", "r.csv:1, column 'u': sensor 'u' is in m here, but in rad in conf"),
        ("time [m],u,v", "r.csv:1, column 'time': time is in m here, but in s in conf.yaml, sy"),
        ("time,u [],v", "r.csv:1: the unit of column 'u' is empty"),
        ("time,u [rad],u [deg]", "r.csv:1, column 'u': 'u' occurs twice"),
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
            "name,field,x,unit\na,u,0.5,K\nb,u,1.5,V\n",
            "s.csv:3, column 'unit': sensor 'b' is in V here, but in K in {s}:2, column 'unit'",
        ),
        (
            "time,a,b",
            "name,field,x [s]\na,u,0.5\nb,u,1.5\n",
            "s.csv:1, column 'x': x is in s here, but in m in conf.yaml, system.units.x",
        ),
        (
            "time,a [K],b",
            "name,field,x,std [V]\na,u,0.5,1\nb,v,1.5,1\n",
            "s.csv:1, column 'std': the std of sensor 'a' is in V here, but in K in",
        ),
    ],
)
def test_units_of_two_files_that_differ_are_refused(ring, write, header, table, message) -> None:
    stated = dataclasses.replace(ring, units={"x": "m"})
    path, sensors = write("r.csv", csv(header)), write("s.csv", table)
    with pytest.raises(InputError) as error:
        read_recording(path, sensors, stated)
    assert message.format(s=sensors) in str(error.value)


def test_values_are_converted_to_the_units_of_the_configuration(ode, write) -> None:
    stated = dataclasses.replace(
        ode, inputs={"f": "drive"}, units={"t": "s", "u": "rad", "v": "m/s", "f": "N"}
    )
    plain = np.loadtxt(ROWS.splitlines(), delimiter=",")
    path = write("r.csv", csv("time [ms],u [deg],drive [kN]"))
    read = read_recording(path, None, stated)
    np.testing.assert_allclose(read.times, plain[:, 0] / 1000, rtol=1e-12)
    np.testing.assert_allclose(read.values[:, 0], np.deg2rad(plain[:, 1]), rtol=1e-12)
    np.testing.assert_allclose(read.inputs.values["drive"], 1000 * plain[:, 2], rtol=1e-12)
    assert read.units == {"t": "s", "u": "rad", "f": "N"}


def test_noise_and_places_are_converted_with_the_readings(ring, write) -> None:
    stated = dataclasses.replace(ring, units={"x": "m", "u": "K"})
    path = write("r.csv", csv("time,a [degC],b"))
    table = "name,field,x [cm],std,unit\na,u,50,0.1,degC\nb,u,150,0.2,mK\n"
    read = read_recording(path, write("s.csv", table), stated)
    plain = np.loadtxt(ROWS.splitlines(), delimiter=",")
    np.testing.assert_allclose(read.values, plain[:, 1:] * [1, 1e-3] + [273.15, 0], rtol=1e-9)
    assert [s.position for s in read.sensors] == [pytest.approx((0.5,)), pytest.approx((1.5,))]
    assert [s.std for s in read.sensors] == [pytest.approx(0.1), pytest.approx(2e-4)]
    own = write("t.csv", "name,field,x,std [mK],unit\na,u,0.5,100,degC\nb,u,1.5,,K\n")
    assert read_recording(path, own, stated).sensors[0].std == pytest.approx(0.1)


def test_the_first_unit_counts_where_the_configuration_states_none(ring, write) -> None:
    table = write("s.csv", "name,field,x,unit\na,u,0.5,m\nb,u,1.5,cm\n")
    read = read_recording(write("r.csv", csv("time,a,b")), table, ring)
    plain = np.loadtxt(ROWS.splitlines(), delimiter=",")
    np.testing.assert_allclose(read.values, plain[:, 1:] * [1, 0.01], rtol=1e-12)
    assert read.units == {"u": "m"}


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


def test_a_netcdf_is_converted(ring, recording: Recording, tmp_path: Path) -> None:
    write_netcdf(recording, tmp_path / "r.nc", ["x"])
    stated = dataclasses.replace(ring, units={"t": "ms", "x": "cm", "u": "mK"})
    # On an axis of 2 cm, only sensors within it are accepted.
    near = dataclasses.replace(recording.sensors[0], position=(0.01,), std=0.1)
    far = dataclasses.replace(recording.sensors[1], position=(0.015,))
    write_netcdf(dataclasses.replace(recording, sensors=(near, far)), tmp_path / "r.nc", ["x"])
    read = read_recording(str(tmp_path / "r.nc"), None, stated)
    np.testing.assert_allclose(read.times, 1000 * recording.times, rtol=1e-12)
    np.testing.assert_allclose(read.values, recording.values * [1000, 1], rtol=1e-12)
    assert read.sensors[0].position == pytest.approx((1.0,))
    assert read.sensors[0].std == pytest.approx(100)


@pytest.mark.parametrize(
    ("name", "unit", "message"),
    [
        ("time", "m since 2020-01-01", "'time': time is in m here, but in s in conf.yaml"),
        ("x", "K", "'x': x is in K here, but in m in conf.yaml, system.units.x"),
        ("value", "V", "sensor 'a' is in K here, but in V in"),
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
