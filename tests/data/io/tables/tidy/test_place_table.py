"""Tables with one row for each time and place become tables with a column for each sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.data.io.in_memory import read_in_memory
from dashred.data.io.reader import read_episodes
from dashred.data.io.tables.table_layout import TableLayout
from dashred.physics.grids.grid import Axis
from tests.data.conftest import PlainSystem

TIMES = 0.5 * np.arange(12)
PLACES = (0.25, 1.0, 1.75)


def value(time: float, place: float) -> float:
    return float(np.round(np.sin(time) * (1 + place), 6))


def rows(by_time: bool = True, run: str = "") -> list[str]:
    pairs = [(t, x) for t in TIMES for x in PLACES]
    pairs = pairs if by_time else sorted(pairs, key=lambda pair: pair[1])
    return [f"{t},{x},{value(t, x)},{7 + t},{run}" for t, x in pairs]


def text(*blocks: list[str], header: str = "time,x,u,power,run") -> str:
    return "\n".join([header, *(row for block in blocks for row in block), ""])


@pytest.mark.parametrize("by_time", [True, False])
def test_every_place_has_a_sensor(ring, write, by_time):
    found = read_episodes(write("r.csv", text(rows(by_time))), None, ring, TableLayout())
    recording = found.single("r")
    assert recording.names == ("u at 0.25", "u at 1", "u at 1.75")
    assert [sensor.position for sensor in recording.sensors] == [(x,) for x in PLACES]
    np.testing.assert_array_equal(recording.times, TIMES)
    expected = [[value(t, x) for x in PLACES] for t in TIMES]
    np.testing.assert_array_equal(recording.values, expected)
    assert found.left_out == ("power", "run")


def test_a_data_frame_is_read_as_the_file(ring, write):
    path = write("r.csv", text(rows()))
    expected = read_episodes(path, None, ring, TableLayout())
    assert read_in_memory(pd.read_csv(path), None, ring, TableLayout()).sha256() == (
        expected.sha256()
    )


@settings(max_examples=25, deadline=None)
@given(kept=st.sets(st.integers(0, len(TIMES) * len(PLACES) - 1), min_size=30))
def test_rows_that_are_missing_are_missing_readings(tmp_path_factory, kept):
    every = rows()
    path = tmp_path_factory.mktemp("rows") / "r.csv"
    path.write_text(text([every[i] for i in sorted(kept)]))
    ring = PlainSystem((Axis("x", 2.0, 16),))
    recording = read_episodes(str(path), None, ring, TableLayout()).single("r")
    assert int(np.isfinite(recording.values).sum()) == len(kept)
    for time, row in zip(recording.times, recording.values, strict=True):
        for sensor, found in zip(recording.sensors, row, strict=True):
            assert np.isnan(found) or found == value(time, sensor.position[0])


def test_episodes_inputs_and_units_are_read(ring, write):
    system = replace(ring, inputs={"e": "power"}, units={"x": "m"})
    header = "time,x (cm),u,power,episode"
    in_cm = [
        [f"{t},{100 * x},{value(t, x)},{7 + t},{run}" for t in TIMES for x in PLACES]
        for run in ("b", "a")
    ]
    found = read_episodes(write("r.csv", text(*in_cm, header=header)), None, system, TableLayout())
    assert [part.name for part in found.episodes] == ["b", "a"]
    for part in found.episodes:
        assert [sensor.position for sensor in part.recording.sensors] == [(x,) for x in PLACES]
        np.testing.assert_array_equal(part.recording.inputs.values["power"], 7 + TIMES)


def test_two_axes_make_a_place(make_system, write):
    plane = make_system(("x", 2.0, 16), ("y", 2.0, 16))
    lines = [f"{t},{x},{y},{t + x + 10 * y}" for t in TIMES for x in (0.5, 1.0) for y in (0.0, 1.5)]
    found = read_episodes(write("r.csv", text(lines, header="t,x,y,u")), None, plane, TableLayout())
    recording = found.single("r")
    assert recording.names == ("u at 0.5, 0", "u at 0.5, 1.5", "u at 1, 0", "u at 1, 1.5")
    np.testing.assert_allclose(recording.values[0], [0.5, 15.5, 1.0, 16.0])


@pytest.mark.parametrize(
    ("lines", "header", "message"),
    [
        ([*rows(), rows()[4]], "time,x,u,power,run", "this place has a second row at this time"),
        ([*rows()[:5], "1.0,,0.3,7,"], "time,x,u,power,run", "the place is missing here"),
        (rows(), "time,x,w,power,run", "no column has the name of a field or let"),
        ([r.replace(",1.75,", ",2.5,") for r in rows()], "time,x,u,power,run", "outside the axis"),
    ],
)
def test_what_is_wrong_is_told(ring, write, lines, header, message):
    with pytest.raises(InputError, match=message) as raised:
        read_episodes(write("r.csv", text(lines, header=header)), None, ring, TableLayout())
    assert raised.value.where and "r.csv" in raised.value.where


def test_a_table_without_times_is_refused(ring, write):
    lines = [row.partition(",")[2] for row in rows()]
    path = write("r.csv", text(lines, header="x,u,power,run"))
    with pytest.raises(InputError, match="a row for each place needs times"):
        read_episodes(path, None, ring, TableLayout(step=0.5))
