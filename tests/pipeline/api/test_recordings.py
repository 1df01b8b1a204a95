"""Recordings in memory are read and refused as those in files are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import dashred


def sha256(problem: dashred.Problem) -> str:
    assert problem._recorded is not None
    return problem._recorded.sha256()


def test_a_frame_is_the_recording_that_a_dataset_is(
    quick: Path, recorded: xr.Dataset, frame: pd.DataFrame, places: pd.DataFrame, tmp_path: Path
) -> None:
    frame.to_csv(tmp_path / "mine.csv", index=False)
    places.to_csv(tmp_path / "places.csv", index=False)
    table = tmp_path / "places.csv"
    given: list[tuple[Any, Any]] = [
        (recorded, None),
        (frame, places),
        (frame.set_index("time"), places.set_index("name")),
        (frame, table),
        (tmp_path / "mine.csv", str(table)),
        (str(tmp_path / "mine.csv"), places),
    ]
    found = {
        sha256(dashred.Problem.from_yaml(quick, recording=recording, sensors=sensors))
        for recording, sensors in given
    }
    assert len(found) == 1


def test_a_recording_comes_back_as_a_dataset(quick: Path, recorded: xr.Dataset) -> None:
    ours = dashred.Problem.from_yaml(quick, recording=recorded).recording
    assert ours is not None
    xr.testing.assert_equal(ours, recorded)


def test_it_is_copied(quick: Path, recorded: xr.Dataset, frame: pd.DataFrame) -> None:
    mine = recorded.copy(deep=True)
    problem = dashred.Problem.from_yaml(quick, recording=mine)
    before = sha256(problem)
    mine["value"].values[:] = 0
    assert sha256(problem) == before


Change = Callable[[xr.Dataset], Any]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda ds: ds.drop_vars("time"), "recording: the recording has no variable 'time'"),
        (lambda ds: ds.drop_vars("value"), "has no variable 'value'"),
        (
            lambda ds: ds.transpose(),
            r"recording: 'value' has the dimensions \(sensor, time\) instead of",
        ),
        (lambda ds: ds.assign(value=ds["value"].astype(object)), "its dtype is object"),
        (
            lambda ds: ds.assign_coords(time=pd.date_range("2020", periods=41)),
            "its dtype is datetime64(.|\n)*write times as numbers",
        ),
        (
            lambda ds: ds.assign_coords(time=np.r_[ds["time"][:-1], np.nan]),
            "recording, sample 41, 'time': the time is missing",
        ),
        (lambda ds: ds.assign_coords(time=np.r_[ds["time"][:-1], 0.0]), "time decreases"),
        (
            lambda ds: ds.assign_coords(name=("sensor", ["s1"] * 6)),
            "recording: 's1' occurs twice",
        ),
        (lambda ds: ds.isel(time=slice(0)), "0 samples are too few"),
        (lambda ds: ds.isel(sensor=slice(0)), "no sensor"),
        (lambda ds: xr.Dataset(), "has no variable 'name'"),
        (lambda ds: ds["value"], r"type DataArray(.|\n)*to_dataset\(name='value'\)"),
        (lambda ds: ds.to_dict(), "type dict(.|\n)*xarray.Dataset, a pandas.DataFrame"),
        (lambda ds: ds["value"].values, "type ndarray"),
        (lambda ds: ds.assign(value=ds["value"] * np.inf), "the value is infinite"),
        (lambda ds: "none.nc", "none.nc: no such file"),
        (lambda ds: "none.xlsx", "none.xlsx: no such file"),
    ],
)
def test_wrong_datasets(quick: Path, recorded: xr.Dataset, change: Change, says: str) -> None:
    with pytest.raises(dashred.InputError, match=says):
        dashred.Problem.from_yaml(quick, recording=change(recorded))


def test_a_spreadsheet_is_refused(quick: Path, tmp_path: Path) -> None:
    path = tmp_path / "mine.xlsx"
    path.write_bytes(b"PK\x03\x04\x14\x00\x06\x00")
    with pytest.raises(dashred.InputError, match="binary file"):
        dashred.Problem.from_yaml(quick, recording=str(path))


def test_a_unit_that_disagrees(recorded: xr.Dataset, quick: Path) -> None:
    wrong = recorded.assign_coords(time=recorded["time"].assign_attrs(units="m"))
    units = {"system": {"units": {"t": "s"}}}
    with pytest.raises(dashred.InputError, match=r"recording, 'time': time is in m here"):
        dashred.Problem.from_yaml(quick, recording=wrong, overrides=units)


def test_a_dataset_describes_its_sensors_itself(
    quick: Path, recorded: xr.Dataset, places: pd.DataFrame
) -> None:
    with pytest.raises(dashred.InputError, match="describes its sensors itself"):
        dashred.Problem.from_yaml(quick, recording=recorded, sensors=places)


FrameChange = Callable[[pd.DataFrame], Any]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda df: df.assign(theta="x"), "recording, column 'theta': the column does not hold"),
        (lambda df: df.assign(theta=df["theta"].astype(object)), "its dtype is object"),
        (lambda df: df.assign(theta=df["theta"] > 0), "its dtype is bool"),
        (
            lambda df: df.assign(time=df["time"].where(df.index != 3)),
            r"recording.iloc\[3\], column 'time': the time is missing",
        ),
        (lambda df: df.assign(time=df["time"].to_numpy()[::-1]), r"iloc\[1\].*time decreases"),
        (lambda df: pd.concat([df, df[["theta"]]], axis=1), "'theta' occurs twice"),
        (lambda df: df.rename(columns={"theta": "theta [m]"}), "sensor 'theta' is in m here"),
        (lambda df: df.rename(columns={"theta": "thet"}), "(.|\n)*did you mean theta"),
        (lambda df: df.rename(columns={"theta": ""}), "column 2 has no name"),
        (lambda df: df[["time"]], "the recording has no sensor"),
        (lambda df: df.iloc[:0], "the DataFrame is empty"),
        (lambda df: pd.DataFrame(), "the DataFrame is empty"),
        (lambda df: df.iloc[:7], "7 samples are too few"),
        (lambda df: df.assign(theta=np.nan), "'theta' has no values"),
        (lambda df: df.T.set_index([[1, 2], [3, 4]]).T, "several levels"),
        (lambda df: df["theta"], "type Series"),
    ],
)
def test_wrong_frames(swing: pd.DataFrame, change: FrameChange, says: str) -> None:
    with pytest.raises(dashred.InputError, match=says):
        dashred.Problem.from_yaml("pendulum", recording=change(swing))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda df: None, "the positions of the sensors"),
        (lambda df: df.drop(columns="x"), "sensors: the table of sensors has no column 'x'"),
        (lambda df: df.assign(x=99.0), r"sensors.iloc\[0\]: .*outside the axis"),
        (lambda df: df.assign(field="w"), "'w', which the system does not have"),
        (lambda df: df.iloc[:0], "the DataFrame is empty"),
        (lambda df: df.assign(colour="red"), "unknown column 'colour'"),
        (lambda df: [1, 2], "type list"),
    ],
)
def test_wrong_tables_of_sensors(
    quick: Path, frame: pd.DataFrame, places: pd.DataFrame, change: FrameChange, says: str
) -> None:
    with pytest.raises(dashred.InputError, match=says):
        dashred.Problem.from_yaml(quick, recording=frame, sensors=change(places))


def test_dates_are_times_and_other_columns_are_left_out(swing: pd.DataFrame) -> None:
    dated = swing.assign(time=pd.to_datetime(swing["time"], unit="s"), remark="calm")
    read = dashred.Problem.from_yaml("pendulum", recording=dated).recording
    assert read is not None
    np.testing.assert_allclose(read["time"], swing["time"], atol=1e-9)
    assert list(read["name"].values) == ["theta"]


def test_sensors_alone_are_no_recording(places: pd.DataFrame) -> None:
    with pytest.raises(dashred.InputError, match="sensors are given without a recording"):
        dashred.Problem.from_yaml("rde", sensors=places)


def test_episodes_and_missing_values_are_read(swing: pd.DataFrame) -> None:
    theta = swing["theta"].astype("Float64")
    theta[5] = pd.NA
    halves = swing.assign(theta=theta, episode=["a"] * 100 + ["b"] * 100)
    problem = dashred.Problem.from_yaml("pendulum", recording=halves)
    assert "200 samples of 1 sensors" in repr(problem)
    assert problem.recording is not None
    assert set(problem.recording["episode"].values) == {"a", "b"}
    assert np.isnan(problem.recording["value"].values[5, 0])
