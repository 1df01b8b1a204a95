"""Measured inputs are read, written and selected together with the sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from dashred.core.errors import InputError
from dashred.data.clocks.resampling import resample
from dashred.data.io.reader import read_recording
from dashred.data.io.write_netcdf import write_netcdf


def lines(cell: str = "") -> str:
    rows = [f"{0.1 * i:.1f},{i},{-i},{2 * i}" for i in range(25)]
    rows[7] = f"0.7,7,-7,{cell or 14}"
    return "\n".join(["time,u,v,power", *rows]) + "\n"


@pytest.fixture
def driven(ode):
    return replace(ode, inputs={"e": "power"})


def test_a_column_of_an_input_is_no_sensor(driven, write):
    recording = read_recording(write("r.csv", lines()), None, driven)
    assert recording.names == ("u", "v")
    np.testing.assert_array_equal(recording.inputs.values["power"], 2.0 * np.arange(25))
    chosen, _ = resample(recording.select(["v"]), 0.11)
    assert chosen.names == ("v",) and len(chosen.times) == 22
    # The input is not resampled to the clock of the analysis.
    assert len(chosen.inputs.times) == 25


def test_what_is_written_is_read(driven, write, tmp_path):
    recording = read_recording(write("r.csv", lines()), None, driven)
    write_netcdf(recording, tmp_path / "r.nc")
    again = read_recording(str(tmp_path / "r.nc"), None, driven)
    np.testing.assert_array_equal(again.inputs.values["power"], recording.inputs.values["power"])
    assert again.sha256() == recording.sha256()


def test_another_input_is_another_recording(driven, write):
    first = read_recording(write("r.csv", lines()), None, driven)
    other = read_recording(write("s.csv", lines("15")), None, driven)
    assert first.sha256() != other.sha256()


def test_an_input_without_its_column_or_with_a_gap_is_refused(driven, write):
    with pytest.raises(InputError, match="no column 'force' for the input e"):
        read_recording(write("r.csv", lines()), None, replace(driven, inputs={"e": "force"}))
    few = "\n".join(f"{i},{i},{-i},{i if i < 9 or i > 20 else ''}" for i in range(30))
    with pytest.raises(InputError, match="no value between 8 and 21") as refused:
        read_recording(write("s.csv", f"time,u,v,power\n{few}\n"), None, driven)
    assert "s.csv, column 'power'" in str(refused.value) and "hold: true" in str(refused.value)


def test_inputs_and_sensors_have_their_own_rows(driven, write):
    """A logger writes a row for each device: where one has a value, the others have none."""
    rows = [f"{0.1 * i:.1f},{i},{-i}," for i in range(30)]
    rows += [f"{0.1 * i - 0.05:.2f},,,{i}" for i in range(31)]
    rows.sort(key=lambda row: float(row.split(",")[0]))
    recording = read_recording(write("r.csv", "\n".join(["time,u,v,power", *rows])), None, driven)
    assert len(recording.inputs.times) == 31 and len(recording.times) == 30
    assert not np.isnan(recording.values).any()
    found = np.interp(0.1, recording.inputs.times, recording.inputs.values["power"])
    assert found == pytest.approx(1.5)


@pytest.mark.parametrize("held", [False, True])
def test_two_inputs_with_different_rows_are_both_known_at_each(ode, write, held):
    system = replace(
        ode, inputs={"e": "power", "f": "force"}, held_inputs=("power",) if held else ()
    )
    rows = [f"{i},{i},{-i},{i if i % 2 == 0 else ''},{i}" for i in range(25)]
    text = "\n".join(["time,u,v,power,force", *rows])
    inputs = read_recording(write("r.csv", text), None, system).inputs
    expected = [i - i % 2 if held else i for i in range(25)]
    np.testing.assert_array_equal(inputs.values["power"], expected)
    np.testing.assert_array_equal(inputs.values["force"], range(25))


def test_an_input_that_begins_late_is_refused(driven, write):
    rows = [f"{i},{i},{-i},{i if i else ''}" for i in range(25)]
    with pytest.raises(InputError, match="the inputs cover 1 to 24"):
        read_recording(write("r.csv", "\n".join(["time,u,v,power", *rows])), None, driven)
    empty = [f"{i},{i},{-i}," for i in range(25)]
    with pytest.raises(InputError, match="the input has no values"):
        read_recording(write("s.csv", "\n".join(["time,u,v,power", *empty])), None, driven)


def test_a_held_input_keeps_its_last_value(ode, write):
    held = replace(ode, inputs={"e": "power"}, held_inputs=("power",))
    rows = [f"{i},{i},{-i},{i if i in (0, 3, 20) else ''}" for i in range(25)]
    recording = read_recording(write("r.csv", "\n".join(["time,u,v,power", *rows])), None, held)
    np.testing.assert_array_equal(recording.inputs.values["power"], [0, 3, 20, 20])
    np.testing.assert_array_equal(recording.inputs.times, [0, 3, 20, 24])


def test_one_column_may_be_two_inputs(ode, write):
    """The second acts later, say."""
    two = replace(ode, inputs={"e": "power", "late": "power"})
    recording = read_recording(write("r.csv", lines()), None, two)
    assert list(recording.inputs.values) == ["power"]
    units = replace(two, units={"e": "W", "late": "mW"})
    text = lines().replace("power", "power [W]")
    with pytest.raises(InputError, match="two inputs read the column 'power' in different units"):
        read_recording(write("s.csv", text), None, units)


@pytest.mark.parametrize(("cell", "says"), {"inf": "infinite", "1e300": "beyond 1e\\+100"}.items())
def test_an_input_that_cannot_be_one_is_refused(driven, write, cell, says):
    with pytest.raises(InputError, match=f"input e is {says} here") as refused:
        read_recording(write("r.csv", lines(cell)), None, driven)
    assert "r.csv:9, column 'power'" in str(refused.value)


@pytest.fixture
def dataset(driven, write, tmp_path):
    """Return a recording whose inputs have their own clock, with the same times."""
    write_netcdf(read_recording(write("r.csv", lines()), None, driven), tmp_path / "r.nc")
    return xr.load_dataset(tmp_path / "r.nc", engine="h5netcdf")


def read_again(dataset, driven, tmp_path):
    dataset.to_netcdf(tmp_path / "s.nc", engine="h5netcdf")
    return read_recording(str(tmp_path / "s.nc"), None, driven)


@pytest.mark.parametrize("part", [slice(1, None), slice(None, -1)])
def test_a_clock_of_inputs_that_does_not_cover_the_samples_is_refused(
    dataset, driven, tmp_path, part
):
    with pytest.raises(InputError, match=r"the inputs cover .* samples run from 0 to 2\.4"):
        read_again(dataset.isel(input_time=part), driven, tmp_path)


@pytest.mark.parametrize("value", [np.inf, 1e300, np.nan])
def test_a_netcdf_s_input_that_cannot_be_one_is_refused(dataset, driven, tmp_path, value):
    dataset["power"][3] = value
    with pytest.raises(InputError, match="sample 4, 'power'"):
        read_again(dataset, driven, tmp_path)


def test_an_infinite_time_of_an_input_is_refused(dataset, driven, tmp_path):
    times = dataset["input_time"].values.copy()
    times[-1] = np.inf
    with pytest.raises(InputError, match="'input_time' does not increase"):
        read_again(dataset.assign_coords(input_time=times), driven, tmp_path)


def test_clocks_that_count_from_different_days_are_refused(dataset, driven, tmp_path):
    dataset["time"].attrs["units"] = "s since 2020-01-01"
    dataset["input_time"].attrs["units"] = "s since 2020-01-01T00:00:00Z"
    assert read_again(dataset, driven, tmp_path).inputs.times[-1] == 2.4
    dataset["input_time"].attrs["units"] = "s since 2020-01-02"
    with pytest.raises(
        InputError, match="counts since 2020-01-02, but 'time' counts since 2020-01-01"
    ):
        read_again(dataset, driven, tmp_path)
