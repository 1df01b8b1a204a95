"""Recordings and tables of sensors in CSV; every error has its location."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.data.io.reader import read_episodes, read_recording
from dashred.data.io.sensors_table import read_sensors
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.csv_table import read_table
from dashred.data.io.tables.table_layout import TableLayout
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor

TABLE = "name,field,x,std\na,u,0.5,0.01\nb,v,1.5,\n"
FILES = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def rows(count=25, header="time,u,v"):
    return [header] + [f"{0.1 * i:.1f},{i},{-i}" for i in range(count)]


def text(lines):
    return "\n".join(lines) + "\n"


def test_an_ode_recording_needs_no_table(ode, write):
    recording = read_recording(write("r.csv", text(rows(header="time,v,u"))), None, ode)
    assert recording.sensors == (Sensor("v", "v"), Sensor("u", "u"))
    np.testing.assert_allclose(recording.times, 0.1 * np.arange(25))
    np.testing.assert_array_equal(recording.values[:, 1], -np.arange(25))


def test_a_table_places_the_columns_whatever_their_order(ring, write):
    recording = read_recording(
        write("r.csv", text(rows(header="b,time,a").copy()[:1] + [f"7,{i},8" for i in range(20)])),
        write("s.csv", TABLE),
        ring,
    )
    assert recording.sensors == (Sensor("b", "v", (1.5,), None), Sensor("a", "u", (0.5,), 0.01))
    assert recording.values.tolist() == [[7.0, 8.0]] * 20


def test_empty_cells_and_nan_are_missing(ode, write):
    lines = rows()
    lines[3], lines[5] = "0.2,,1e-3", "0.4,NaN, 2 "
    values = read_recording(write("r.csv", text(lines)), None, ode).values
    assert np.argwhere(np.isnan(values)).tolist() == [[2, 0], [4, 0]]
    assert values[[2, 4], 1].tolist() == [1e-3, 2.0]


@pytest.mark.parametrize("word", ["NA", "N/A", "null", "None", "-"])
def test_a_word_for_a_missing_value_is_one_among_numbers(ode, write, word):
    lines = rows()
    lines[1], lines[4] = f"0,{word},1", f"0.3,3,{word} "
    values = read_recording(write("r.csv", text(lines)), None, ode).values
    assert np.argwhere(np.isnan(values)).tolist() == [[0, 0], [3, 1]]


def test_such_a_word_is_a_name_among_texts(ode, write):
    """Sodium, and an error in a column of numbers with another text."""
    table = read_table(write("t.csv", "sensor,value\nNA,1\nK,null\nNA,2\n"))
    assert table.texts("sensor") == ["NA", "K", "NA"]
    assert table.texts("value") == ["1", "", "2"]
    lines = rows()
    lines[1], lines[2] = "0,NA,1", "0.1,off,1"
    with pytest.raises(InputError, match="'off' is not a number"):
        read_recording(write("r.csv", text(lines)), None, ode)


@pytest.mark.parametrize("ending", ["\r\n", "\r"])
def test_other_line_endings_a_byte_order_mark_and_blank_lines_do_not_matter(ode, write, ending):
    lines = rows()
    plain = read_recording(write("a.csv", text(lines)), None, ode)
    odd = "\ufeff" + ending.join([*lines[:4], "", *lines[4:], "", ""])
    assert read_recording(write("b.csv", odd), None, ode).sha256() == plain.sha256()


def test_columns_that_are_not_sensors_are_left_out(ode, write):
    """Whatever they contain."""
    lines = [f"{line},note {i}" for i, line in enumerate(rows())]
    lines[0] = "time,u,v,remark"
    read = read_episodes(write("r.csv", text(lines)), None, ode)
    assert read.left_out == ("remark",)
    assert read.single("r.csv").names == ("u", "v")


def test_columns_without_a_row_in_the_table_of_sensors_are_left_out(ring, write):
    recording = write("r.csv", text(rows(header="time,a,b")))
    read = read_episodes(recording, write("s.csv", "name,field,x\na,u,0.5\n"), ring)
    assert read.left_out == ("b",)
    assert read.single("r.csv").names == ("a",)


def test_a_column_can_be_ignored(ode, write):
    """A column with nearly the name of a sensor, and a sensor."""
    path = write("r.csv", text(rows(header="time,sped,v")))
    read = read_episodes(path, None, ode, TableLayout(ignored=("sped",)))
    assert read.left_out == ()
    assert read.single("r.csv").names == ("v",)
    with pytest.raises(InputError, match="the recording has no column 'w'"):
        read_episodes(path, None, ode, TableLayout(ignored=("w",)))


def test_one_episode_is_accepted_and_a_constant_sensor_too(ode, write):
    lines = ["time,episode,u"] + [f"{i},1,3.5" for i in range(20)]
    assert read_recording(write("r.csv", text(lines)), None, ode).names == ("u",)


def test_numbers_in_brackets_are_names_and_one_alone_is_a_unit(ring, write):
    table = "name,field,x\nu[0],u,0.5\nu [1],u,0.7\nv,v,1.5\n"
    lines = ["time [s],u[0],u [1],v [1]"] + [f"{i},{i},1,2" for i in range(20)]
    recording = read_recording(write("r.csv", text(lines)), write("s.csv", table), ring)
    assert recording.names == ("u[0]", "u [1]", "v")
    assert recording.units == {"t": "s", "v": "1"}


def test_a_table_that_memory_could_not_hold_is_refused_before_it_is_read(ode, tmp_path):
    """A day at a kilohertz: 86 million rows."""
    path = tmp_path / "day.csv"
    with path.open("wb") as file:
        file.write(b"time,u,v\n")
        file.truncate(86_400_000 * 26)  # a sparse file
    began = time.perf_counter()
    with pytest.raises(
        InputError, match=r"the table takes 2246 MB; the limit is 268 MB"
    ) as refused:
        read_recording(str(path), None, ode)
    assert time.perf_counter() - began < 1
    assert "keep one row in 9" in str(refused.value.hint)


def changed(line, new):
    lines = rows()
    lines[line - 1] = new
    return text(lines)


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_a_spreadsheet_may_write_another_encoding(ode, write, encoding):
    contents = text(rows(header="time,u,v,Größe m³")[:1] + [f"{row},1" for row in rows()[1:]])
    recording = read_recording(write("r.csv", contents.encode(encoding)), None, ode)
    assert recording.names == ("u", "v")


BAD = {
    "empty": ("", "r.csv: the file is empty"),
    "blank": (" \n\n", "the file is empty"),
    "header alone": ("time,u\n", "0 samples are too few"),
    "short": (text(rows(7)), "7 samples are too few: at least 8"),
    "binary": (changed(4, "0.2,1,é\0").encode("latin-1"), "r.csv: this is a binary file"),
    "latin-1": (changed(4, "0.2,1,é").encode("latin-1"), "'é' is not a number"),
    "word": (changed(7, "0.5,five,1"), "r.csv:7, column 'u': 'five' is not a number"),
    "underscore": (changed(7, "0.5,1_000,1"), "r.csv:7, column 'u': '1_000' is not a number"),
    "other digits": (changed(7, "0.5,٣,1"), "r.csv:7, column 'u'"),
    "word for time": (changed(7, "noon,5,1"), "r.csv:7, column 'time': 'noon'"),
    "no time": (text(rows(header="clock,u,v")), "no column 'time'"),
    "thousands": ("time;u\n0,0;1,5\n0,1;1.001,5\n", "r.csv:3: '1.001,5' has a point, but this"),
    "a date": (changed(7, "2024-05-17T12:30:00Z,5,1"), "seconds since the start"),
    "a time of day": (changed(7, "12:30:05,5,1"), "write times as numbers"),
    "missing time": (changed(7, ",5,1"), "r.csv:7, column 'time': the time is missing"),
    "infinite time": (changed(7, "inf,5,1"), "r.csv:7, column 'time'"),
    "time back": (changed(7, "0.35,5,1"), "r.csv:7, column 'time': time decreases: 0.35 after 0.4"),
    "time twice": (changed(7, "0.4,5,1"), "r.csv:7, column 'time': time is repeated"),
    "infinite": (changed(7, "0.5,5,-inf"), "r.csv:7, column 'v': the value is infinite"),
    "too large": (changed(7, "0.5,5,1e999"), "r.csv:7, column 'v': the value is infinite"),
    "ragged": (changed(7, "0.5,5"), "r.csv:7: the row has 2 cells, but the first line names 3"),
    "wide": (changed(7, "0.5,5,1,"), "r.csv:7: the row has 4 cells"),
    "decimal commas between commas": (changed(7, "0,5,5,0,1"), "do the decimals use a comma?"),
    "two times": (text(rows(header="t,Date,v")), "which column has the times: t, Date?"),
    "open quote": (changed(7, '0.5,"5,1'), "not a readable CSV"),
    "numbered": (
        text(rows(header="time,u[0],u[1]")),
        "no column is a sensor: the columns are u[0], u[1]",
    ),
    "duplicate": (text(rows(header="time,u,u")), "'u' occurs twice"),
    "nearest": (
        text(rows(header="time,u,sped")),
        "r.csv:1, column 'sped': column 'sped' is not known: did you mean speed?",
    ),
    "silent": (
        text(["time,u,v"] + [f"{i},{i}," for i in range(20)]),
        "sensor 'v' has no values",
    ),
    "no sensor": (text(["time"] + [str(i) for i in range(20)]), "the recording has no sensor"),
    "short episode": (
        text(["time,episode,u"] + [f"{i},{i // 25},1" for i in range(30)]),
        "r.csv, episode '1': 5 samples are too few: at least 6",
    ),
    "episode again": (
        text(["time,episode,u"] + [f"{i},{i // 20 % 2},1" for i in range(60)]),
        "r.csv:42, column 'episode': episode '0' continues here",
    ),
    "no episode": (
        text(["time,episode,u"] + [f"{i},{'a' if i < 30 else ''},1" for i in range(60)]),
        "r.csv:32, column 'episode': the episode name is missing here",
    ),
    "back within an episode": (
        text(["time,episode,u"] + [f"{i % 30 if i != 45 else 3},{i // 30},1" for i in range(60)]),
        "r.csv:47, column 'time': time decreases: 3 after 14",
    ),
    "silent episode": (
        text(["time,episode,u"] + [f"{i},{i // 30},{1 if i < 30 else ''}" for i in range(60)]),
        "r.csv, episode '1': sensor 'u' has no values",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_recording_is_refused_where_it_is_bad(ode, write, case):
    contents, message = BAD[case]
    with pytest.raises(InputError) as caught:
        read_recording(write("r.csv", contents), None, ode)
    assert message in str(caught.value)


def test_a_table_states_regions_and_noise_by_the_reading(ring, write):
    table = "name,field,x,x_width,std\na,u,0.5,0.4,5% of reading\nb,v,1.5,,counts\n"
    recording = read_recording(
        write("r.csv", text(rows(header="time,a,b"))), write("s.csv", table), ring
    )
    first, second = recording.sensors
    assert first.widths == (0.4,) and second.widths == ()
    laws = [tuple(sensor.noise_law or ()) for sensor in (first, second)]
    assert laws[0] == pytest.approx((0.0, 0.05, 0.0)) and laws[1] == (0.5, 0.0, 1.0)


BAD_TABLES = {
    "too wide": ("name,field,x,x_width\na,u,0.5,3\nb,v,1,\n", "x_width is 3"),
    "no x": ("name,field,std\na,u,1\n", "no column 'x'"),
    "unknown column": ("name,field,x,sdt\na,u,1,1\n", "did you mean std"),
    "no rows": ("name,field,x\n", "has no sensors"),
    "unknown field": (TABLE.replace("a,u", "a,w"), "s.csv:2: sensor 'a' reads 'w'"),
    "outside": (TABLE.replace("0.5", "2.5"), "s.csv:2: sensor 'a' is at x = 2.5, outside"),
    "negative": (TABLE.replace("0.5", "-0.1"), "outside the axis"),
    "nowhere": (TABLE.replace("0.5", ""), "has no x coordinate"),
    "not a place": (TABLE.replace("0.5", "left"), "s.csv:2, column 'x': 'left'"),
    "zero std": (TABLE.replace("0.01", "0"), "is '0', but must be a positive"),
    "negative std": (TABLE.replace("0.01", "-1"), "is '-1', but must be a positive"),
    "infinite std": (TABLE.replace("0.01", "inf"), "must be a positive"),
    "twice": (TABLE.replace("b,v", "a,v"), "'a' occurs twice"),
    "reserved": (TABLE.replace("a,u", "time,u"), "'time' is not a valid sensor name"),
    "not recorded": (TABLE + "c,u,1,\n", "s.csv: sensor 'c' has no column"),
    "empty": ("", "s.csv: the file is empty"),
}


@pytest.mark.parametrize("case", BAD_TABLES)
def test_a_bad_table_of_sensors_is_refused_where_it_is_bad(ring, write, case):
    contents, message = BAD_TABLES[case]
    recording = write("r.csv", text(rows(header="time,a,b")))
    with pytest.raises(InputError) as caught:
        read_recording(recording, write("s.csv", contents), ring)
    assert message in str(caught.value)


def test_a_missing_file_and_a_folder_are_refused(ode, ring, write, tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_recording(str(tmp_path / "none.csv"), None, ode)
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        read_recording(str(tmp_path / "folder.csv"), None, ode)
    with pytest.raises(InputError, match="no such file"):
        read_recording(
            write("r.csv", text(rows(header="time,a,b"))), str(tmp_path / "none.csv"), ring
        )


def test_a_system_in_space_needs_a_table(ring, write):
    with pytest.raises(InputError, match=r"recording\.sensors=PATH"):
        read_recording(write("r.csv", text(rows())), None, ring)


def test_other_formats_are_refused(ode, write):
    with pytest.raises(InputError, match="this is a binary file, and no table of text"):
        read_recording(write("r.xlsx", b"PK\x03\x04\x14\x00\x08\x08"), None, ode)


def test_a_table_of_an_ode_system_has_no_coordinates(ode, write):
    table = write("s.csv", "name,field\nangle,u\n")
    assert read_sensors(read_table(table), ode, StatedUnits(ode)) == (Sensor("angle", "u"),)


def test_the_pendulum_recording_is_read_quickly(make_system):
    path = Path(__file__).parents[4] / "shared/data/pendulum_single/recording.csv"
    if not path.exists():
        pytest.skip("the real recording is not beside this checkout")
    system = make_system()
    object.__setattr__(system, "fields", ("theta", "omega"))
    started = time.process_time()
    recording = read_recording(str(path), None, system)
    assert time.process_time() - started < 0.5
    assert recording.values.shape == (55_001, 2)
    assert recording.values[0].tolist() == [-1.618429, 1.848254]
    assert recording.times[-1] == 55.0


def holds_what_readers_promise(recording):
    assert isinstance(recording, Recording)
    assert recording.values.shape == (len(recording.times), len(recording.sensors))
    assert np.all(np.diff(recording.times) > 0)
    assert not np.isinf(recording.values).any()
    assert not np.isnan(recording.values).all(axis=0).any()


def read_or_refused(path, table, system):
    try:
        holds_what_readers_promise(read_recording(path, table, system))
    except InputError as error:
        assert error.what


@FILES
@given(contents=st.one_of(st.binary(max_size=300), st.text(max_size=300)))
def test_any_garbage_is_read_or_refused(ode, ring, write, contents):
    if isinstance(contents, str):
        contents = contents.encode("utf-8", "surrogatepass")
    path = write("r.csv", contents)
    read_or_refused(path, None, ode)
    read_or_refused(write("good.csv", text(rows(header="time,a,b"))), path, ring)


CELLS = st.sampled_from(
    [
        "0",
        "1",
        "-2.5",
        "1e300",
        "1e400",
        "nan",
        "",
        " ",
        "x",
        "inf",
        '"3"',
        '"',
        "1,2",
        "\x00",
        "0x1",
    ]
)


@FILES
@given(
    header=st.lists(
        st.sampled_from(["time", "u", "v", "episode", "w", ""]), min_size=1, max_size=4
    ),
    changes=st.lists(st.tuples(st.integers(0, 24), st.integers(0, 3), CELLS), max_size=4),
    newline=st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_any_nearly_right_table_is_read_or_refused(ode, write, header, changes, newline):
    cells = [[str(i)] * len(header) for i in range(25)]
    for row, column, cell in changes:
        cells[row][column % len(header)] = cell
    lines = [",".join(header), *(",".join(row) for row in cells)]
    read_or_refused(write("r.csv", newline.join(lines)), None, ode)
