"""Measured inputs are read beside the sensors, and written and selected with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.errors import InputError
from dashred.sensing.clock import resample
from dashred.sensing.reader import read_recording
from dashred.sensing.write_netcdf import write_netcdf


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
    # Whatever the analysis' clock, the input stays as it was measured.
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
    with pytest.raises(InputError, match="input e is missing here") as refused:
        read_recording(write("s.csv", lines("nan")), None, driven)
    assert "s.csv:9" in str(refused.value)
