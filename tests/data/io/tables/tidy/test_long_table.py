"""Tables with one row for each reading become tables with a column for each sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from dashred.core.errors import InputError
from dashred.core.stated.column_names import parse_columns
from dashred.data.io.in_memory import read_in_memory
from dashred.data.io.reader import read_episodes
from dashred.data.io.tables.table_layout import TableLayout

TIMES = 0.5 * np.arange(12)
STATED = {"time": "t", "sensor": "name", "value": "reading"}


def rows(by_time: bool, runs: tuple[str, ...] = ("",)) -> list[str]:
    """Return readings u = i and v = -i, the latter at every second time."""
    found = [
        (run, i if by_time else s, f"{t},{name},{i if name == 'u' else -i},{7 + i}")
        for run in runs
        for s, name in enumerate("uv")
        for i, t in enumerate(TIMES)
        if name == "u" or i % 2 == 0
    ]
    return [f"{row},{run}" for run, _, row in sorted(found, key=lambda row: row[1])]


def text(*args) -> str:
    return "\n".join(["t,name,reading,power,subject", *rows(*args), ""])


@pytest.mark.parametrize("by_time", [True, False])
def test_rows_become_columns_in_any_order(ode, write, by_time):
    layout = TableLayout(headers=STATED)
    found = read_episodes(write("r.csv", text(by_time)), None, ode, layout)
    recording = found.single("r")
    assert recording.names == ("u", "v")
    np.testing.assert_array_equal(recording.times, TIMES)
    np.testing.assert_array_equal(recording.values[:, 0], np.arange(12))
    np.testing.assert_array_equal(recording.values[::2, 1], -np.arange(0, 12, 2))
    assert np.isnan(recording.values[1::2, 1]).all()
    assert found.left_out == ("power", "subject")


def test_it_is_the_recording_of_the_wide_table(ode, write):
    wide = "".join(f"{t},{i},{-i if i % 2 == 0 else ''}\n" for i, t in enumerate(TIMES))
    expected = read_episodes(write("w.csv", f"time,u,v\n{wide}"), None, ode)
    path = write("r.csv", text(False))
    assert read_episodes(path, None, ode, TableLayout(headers=STATED)).sha256() == expected.sha256()
    frame = pd.read_csv(path).rename(columns={old: new for new, old in STATED.items()})
    assert read_in_memory(frame, None, ode, TableLayout()).sha256() == expected.sha256()


def test_episodes_and_inputs_have_columns_of_their_own(ode, write):
    system = replace(ode, inputs={"e": "power"})
    layout = TableLayout(headers={**STATED, "episode": "subject"})
    found = read_episodes(write("r.csv", text(False, ("b", "a"))), None, system, layout)
    assert [part.name for part in found.episodes] == ["b", "a"]
    for part in found.episodes:
        np.testing.assert_array_equal(part.recording.inputs.values["power"], 7 + np.arange(12))


def test_sensors_are_renamed_and_have_units(ode, write):
    long = text(False).replace(",u,", ",Voltage 1 (mV),").replace(",v,", ",2:,")
    headers = {**STATED, "u": "Voltage 1", "v": "2:"}
    system = replace(ode, units={"u": "V"})
    found = read_episodes(write("r.csv", long), None, system, TableLayout(headers=headers))
    np.testing.assert_allclose(found.single("r").values[:, 0], 1e-3 * np.arange(12))
    with pytest.raises(InputError, match="no column 'Voltage 2'"):
        wrong = TableLayout(headers={**headers, "u": "Voltage 2"})
        read_episodes(write("r.csv", long), None, system, wrong)


def test_columns_without_a_header_have_numbers(ode, write):
    long = "\n".join([*rows(True), ""]).replace(",u,", ",1,").replace(",v,", ",2,")
    stated = {"time": 1, "sensor": 2, "value": 3, "u": 1, "v": 2}
    _, headers = parse_columns(stated, "c.yaml")
    found = read_episodes(write("r.csv", long), None, ode, TableLayout(headers=headers))
    np.testing.assert_array_equal(found.single("r").values[:, 0], np.arange(12))
    with pytest.raises(InputError, match="contains '1' twice"):
        parse_columns({"time": 1, "u": 1}, "c.yaml")


def test_faults_have_their_place_in_the_file(ode, write):
    layout, lines = TableLayout(headers=STATED), text(False).splitlines()
    twice = "\n".join([*lines, lines[3], ""])
    with pytest.raises(InputError, match="'u' has a second reading at this time") as told:
        read_episodes(write("r.csv", twice), None, ode, layout)
    assert "r.csv:20, column 'sensor'" in str(told.value)
    for bad, says in (("1,u,x,9,", "'x' is not a number"), ("1,,3,9,", "the sensor has no name")):
        with pytest.raises(InputError, match=says) as told:
            read_episodes(write("r.csv", "\n".join([*lines[:3], bad, ""])), None, ode, layout)
        assert "r.csv:4, column" in str(told.value)
    with pytest.raises(InputError, match="'time' has the name of another column"):
        read_episodes(write("r.csv", text(False).replace(",u,", ",time,")), None, ode, layout)
    system = replace(ode, inputs={"e": "power"})
    other = "\n".join([*lines[:-1], lines[-1].replace("17", "18"), ""])
    with pytest.raises(InputError, match="the input has another value at this time, '17'"):
        read_episodes(write("r.csv", other), None, system, layout)
    with pytest.raises(InputError, match="needs times"):
        no_times = TableLayout(headers={"sensor": "name", "value": "reading"}, step=1.0)
        read_episodes(write("r.csv", "name,reading\nu,1\nv,3\nu,1\n"), None, ode, no_times)


def test_times_of_day_come_together(ode, write):
    stamps = pd.date_range("2024-01-01 22:00", periods=12, freq="h").strftime("%H:%M")
    lines = [f"{stamp},{name},1" for name in "uv" for stamp in stamps]
    layout = TableLayout(headers=STATED)
    with pytest.raises(InputError, match="times of day need all readings of one time together"):
        read_episodes(write("r.csv", "\n".join(["t,name,reading", *lines])), None, ode, layout)
    lines = [f"{stamp},{name},1" for stamp in stamps for name in "uv"]
    found = read_episodes(write("r.csv", "\n".join(["t,name,reading", *lines])), None, ode, layout)
    np.testing.assert_allclose(found.single("r").times, 3600.0 * np.arange(12))


@pytest.mark.parametrize("by_time", [True, False])
def test_how_to_state_it_is_said(ode, write, by_time):
    """The blocks look like episodes, and rows of one time repeat it."""
    with pytest.raises(InputError, match="start again, where 'name' changes") as told:
        read_episodes(write("r.csv", text(by_time)), None, ode)
    assert "recording.columns={sensor: name, value: COLUMN}" in str(told.value)


def test_fields_of_these_names_are_no_long_table(ode, write):
    system = replace(ode, fields=("sensor", "value"))
    path = write("r.csv", "time,sensor,value\n" + "".join(f"{t},1,2\n" for t in TIMES))
    assert read_episodes(path, None, system).single("r").names == ("sensor", "value")


def test_many_rows_at_one_time_may_be_a_long_table(ode, write):
    numbers = text(True).replace(",u,", ",1,").replace(",v,", ",2,").replace("reading", "u")
    with pytest.raises(InputError, match="time is repeated") as told:
        read_episodes(write("r.csv", numbers), None, ode)
    assert "recording.columns={sensor: COLUMN, value: COLUMN}" in str(told.value.hint)
