"""Runs side by side, each with its own times, are episodes."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.data.io.reader import read_episodes
from dashred.data.io.tables.recording_table import read_recording_table
from dashred.data.io.tables.table_layout import TableLayout

LENGTHS = (12, 9)
NAMES = "Time (s),u (mV),v"


def rows() -> list[str]:
    """Return the rows of two runs; the second one is shorter."""
    found = []
    for i in range(max(LENGTHS)):
        runs = [f"{0.5 * i},{i + 100 * run},{-i}" for run in range(2)]
        found.append(
            ",".join(cells if i < n else ",," for cells, n in zip(runs, LENGTHS, strict=True))
        )
    return [*found, ",,,,,"]


HEADS = {
    "repeated labels": f"Run #1,Run #1,Run #1,Run #2,Run #2,Run #2\n{NAMES},{NAMES}",
    "empty cells": f"Run #1,,,Run #2,,\n{NAMES},{NAMES}",
    "other lines": f"A logger\n\nRun #1,,,Run #2,,\n{NAMES},{NAMES}\n,,,,,",
    "prefixes": ",".join(f"Run #{run}: {name}" for run in (1, 2) for name in NAMES.split(",")),
}


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS)
def test_groups_of_runs_are_episodes(ode, write, head):
    path = write("r.csv", "\n".join([head, *rows(), ""]))
    found = read_episodes(path, None, ode)
    assert [part.name for part in found.episodes] == ["Run #1", "Run #2"]
    for run, (part, count) in enumerate(zip(found.episodes, LENGTHS, strict=True)):
        np.testing.assert_array_equal(part.recording.times, 0.5 * np.arange(count))
        expected = np.stack([np.arange(count) + 100 * run, -np.arange(count)], axis=1)
        np.testing.assert_array_equal(part.recording.values, expected)
    assert found.episodes[0].recording.units == {"t": "s", "u": "mV"}


def test_a_fault_has_the_line_of_its_cell(ode, write):
    text = "\n".join([HEADS["empty cells"], *rows()]).replace("103", "x")
    with pytest.raises(InputError, match="'x' is not a number") as told:
        read_episodes(write("r.csv", text), None, ode)
    assert "r.csv:6, column 'u'" in str(told.value)
    with pytest.raises(InputError, match=r"r\.csv:4: the row has 2 cells"):
        read_episodes(write("r.csv", f"{HEADS['empty cells']}\n1,2,3,4,5,6\n1,2\n"), None, ode)


def test_other_labels_must_be_stated(ode, write):
    text = "\n".join([HEADS["empty cells"], *rows(), ""]).replace("Run #", "Cup ")
    with pytest.raises(InputError, match="in groups, Cup 1, Cup 2, each with its own") as told:
        read_episodes(write("r.csv", text), None, ode)
    assert "recording.columns={episode: Cup 1}" in str(told.value.hint)
    layout = TableLayout(headers={"episode": "Cup 1"})
    found = read_episodes(write("r.csv", text), None, ode, layout)
    assert [part.name for part in found.episodes] == ["Cup 1", "Cup 2"]


def test_repeated_names_in_a_group_have_numbers(write):
    names = "Time (s),T (°C),T (°C)"
    text = "\n".join([f"Run 1,,,Run 2,,\n{names},{names}", *rows(), ""])
    table = read_recording_table(write("r.csv", text), TableLayout())
    assert table.columns == ("episode", "Time", "T", "T 2")
    assert table.units == {"Time": "s", "T": "°C", "T 2": "°C"}
    named = read_recording_table(write("r.csv", text), TableLayout(("time", "a", "b")))
    assert named.columns == ("episode", "time", "a", "b")
    whole = read_recording_table(write("r.csv", text), TableLayout((*"tabsuv",)))
    assert whole.columns == (*"tabsuv",)
    layout = TableLayout(headers={"time": "Time", "w": "T 2"})
    assert read_recording_table(write("r.csv", text), layout).columns[1:] == ("time", "T", "w")


@pytest.mark.parametrize(
    "head",
    [
        "Run 1,,,Run 2,,\ntime,u,v,time,u,w",
        "Run 1,,,Run 2,,\ntime,u,v,x,u,v",
        "Run 1,,Run 2,,,\ntime,u,v,time,u,v",
        "Run 1,,,Run 1,,\ntime,u,v,time,u,v",
    ],
)
def test_what_are_no_groups_is_no_episode(write, head):
    path = write("r.csv", "\n".join([head, *rows(), ""]))
    try:
        table = read_recording_table(path, TableLayout())
    except InputError:
        return
    assert "episode" not in table.columns


def test_empty_rows_are_left_out(write):
    table = read_recording_table(write("r.csv", "time,u\n0,1\n,\n1,2\n , \n"), TableLayout())
    assert table.texts("u") == ["1", "2"]
    assert table.location(1).endswith(":4")
