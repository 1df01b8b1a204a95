"""Tables as loggers write them: other lines about the header, no header, no times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.core.stated.column_names import parse_columns
from dashred.data.io.reader import read_episodes
from dashred.data.io.tables.csv_table import Table
from dashred.data.io.tables.recording_table import count_unnamed, read_recording_table
from dashred.data.io.tables.table_layout import TableLayout, split_header

Write = Callable[[str, str], str]
ROWS = "0.0,1.5,2\n0.1,1.25,3\n"


def read(write: Write, text: str, layout: TableLayout | None = None) -> Table:
    return read_recording_table(write("r.csv", text), layout or TableLayout())


@pytest.mark.parametrize(
    "head",
    [
        "time,u,v\n",
        "time,u,v\nsecond,volt,volt\n",
        "A logger of 2024\n\nserial number 17\ntime,u,v\n",
        '"TOA5","Station","CR1000","12"\n"time","u","v"\n"s","V","V"\n"","Avg","Avg"\n',
        "Run #1,Run #1,Run #1\ntime,u,v\n",
        "# a comment\ntime,u,v\n",
        "# time,u,v\n",
        "Samples,1000,\nX0,0.0,\n***End_of_Header***,,\ntime,u,v\n",
        "time,u,v\n(ms),(V),(V)\n\n",
        "Length,A:9,B:9\nStep,5.0E-06,\nUnits,A:V,B:V\ntime,u,v\n",
    ],
)
def test_the_header_is_found_between_other_lines(write: Write, head: str) -> None:
    table = read(write, head + ROWS)
    assert table.columns == ("time", "u", "v")
    np.testing.assert_array_equal(table.numbers("u"), [1.5, 1.25])
    last = head.count("\n") + 2
    assert table.location(1, "u") == f"{table.path}:{last}, column 'u'"


def test_headers_that_nothing_uses_may_be_repeated(write: Write) -> None:
    head = "time,u,Loop,Loop,Loop (2),Loop\n"
    table = read(write, head + "0,1,2,3,4,5\n1,2,3,4,5,6\n")
    assert table.columns == ("time", "u", "Loop", "Loop (3)", "Loop (2)", "Loop (4)")
    assert table.texts("Loop (4)") == ["5", "6"]
    with pytest.raises(InputError, match="'Loop' occurs twice"):
        read(write, head + "0,1,2,3,4,5\n", TableLayout(used=("Loop",)))
    with pytest.raises(InputError, match="'Time' occurs twice"):
        read(write, "Time,u,Time\n0,1,2\n")
    with pytest.raises(InputError, match="'w' occurs twice"):
        read(write, "time,u,u\n0,1,2\n", TableLayout(headers={"w": "u"}, used=("w",)))


def test_a_repeated_header_has_a_number_by_which_it_is_named(write: Write) -> None:
    text = "time,u [V],u [V]\n0,1,3\n1,2,4\n"
    table = read(write, text, TableLayout(headers={"w": "u (2)"}, used=("u", "w")))
    assert table.columns == ("time", "u", "w")
    assert table.units == {"u": "V", "w": "V"}
    assert table.texts("w") == ["3", "4"]
    with pytest.raises(InputError) as told:
        read(write, text, TableLayout(used=("u",)))
    assert told.value.hint == "leave one of them out: recording.ignore=['u (2)']"
    for left_out in ("u", "u (2)"):
        read(write, text, TableLayout(used=("u",), ignored=(left_out,)))
    copied = read(write, "time,u,u,time\n0,1,1,0\n1,2,2,1\n", TableLayout(used=("u",)))
    assert copied.columns == ("time", "u")
    assert copied.rows == [["0", "1"], ["1", "2"]]


def test_names_with_different_units_are_numbered_too(write: Write) -> None:
    text = "time,feed [L/min],feed [g/h],T (K),T (degC)\n0,1,2,3,4\n1,2,3,4,5\n"
    table = read(write, text, TableLayout(used=("T (K)",)))
    assert table.columns == ("time", "feed", "feed (2)", "T (K)", "T (degC)")
    assert table.units["feed (2)"] == "g/h"
    with pytest.raises(InputError, match="'feed' occurs twice"):
        read(write, text, TableLayout(used=("feed",)))


def test_a_column_without_a_header_has_its_number(write: Write) -> None:
    table = read(write, ",time,u,\n0,0,1,5\n1,1,2,6\n", TableLayout(used=("u",)))
    assert table.columns == ("column 1", "time", "u", "column 4")
    assert read(write, "time,u,\n0,1,\n1,2,\n").columns == ("time", "u")


def test_the_line_below_the_header_has_units(write: Write) -> None:
    table = read(write, "time,u [V],v,w\nsecond,mV,-,m/s\n0,1,2,3\n1,2,3,4\n")
    assert table.units == {"time": "second", "u": "V", "w": "m/s"}
    table = read(write, "time,u,v\n(s),[mV],(rad/s)\n0,1,2\n1,2,3\n")
    assert table.units == {"time": "s", "u": "mV", "v": "rad/s"}


def test_settings_may_stand_beside_the_readings(write: Write) -> None:
    """As some oscilloscopes write them: without a header, and each line ends with a comma."""
    settings = ["Record Length,2.5e+03", "Sample Interval,5e-06", ",", "Vertical Units,V"]
    beside = [*settings, *[","] * 8]
    text = "\n".join(f"{left},, {0.5 * i:.2f}, {i}," for i, left in enumerate(beside)) + "\n"
    table = read(write, text, TableLayout(("time", "u")))
    np.testing.assert_array_equal(table.numbers("time"), 0.5 * np.arange(12))
    np.testing.assert_array_equal(table.numbers("u"), np.arange(12))
    assert count_unnamed(write("r.csv", text)) == 2
    with pytest.raises(InputError, match="the columns have no names"):
        read(write, text)


def test_empty_cells_at_the_end_may_be_left_off(write: Write) -> None:
    table = read(write, "Channels,1,\n***End***,,\ntime,u,v,Comment\n" + ROWS + "0.2,1,4,late\n")
    assert table.texts("Comment") == ["", "", "late"]
    np.testing.assert_array_equal(table.numbers("v"), [2, 3, 4])


def test_a_clock_that_starts_again_begins_an_episode(write: Write, ode) -> None:
    lines = [f"{0.1 * (i % 20):.1f},{i},1" for i in range(50)]
    path = write("r.csv", "\n".join(["t_s,u,v", *lines, ""]))
    episodes = read_episodes(path, None, ode).episodes
    assert [(e.name, len(e.recording.times)) for e in episodes] == [("1", 20), ("2", 20), ("3", 10)]
    back = "\n".join(["time,u,v", *lines[:15], *lines[10:20], ""])
    with pytest.raises(InputError, match=r"decreases: 1 after 1\.4"):
        read_episodes(write("r.csv", back), None, ode)


@pytest.mark.parametrize("cells", [["5"] * 8 + ["0"] * 8, ["inf"] * 16])
def test_a_clock_that_stands_still_does_not_start_again(write: Write, ode, cells) -> None:
    lines = [f"{cell},1,2" for cell in cells]
    with pytest.raises(InputError, match="time"):
        read_episodes(write("r.csv", "\n".join(["time,u,v", *lines, ""])), None, ode)


def test_a_time_that_is_repeated_is_counted(write: Write, ode) -> None:
    lines = [f"{0.1 * (i // 2):.1f},{i},1" for i in range(40)]
    with pytest.raises(InputError, match="20 rows repeat the time of the row before"):
        read_episodes(write("r.csv", "\n".join(["time,u,v", *lines, ""])), None, ode)


def test_a_row_with_a_text_in_front_is_a_row(write: Write) -> None:
    table = read(write, "note,time,u\nbegin,0,1\n5,1,2\n")
    assert table.texts("note") == ["begin", "5"]


@pytest.mark.parametrize("end", [",", "\t", ";"])
def test_a_separator_at_the_end_of_each_line_is_left_out(write: Write, end: str) -> None:
    rows = "".join(f"{line}{end}\n" for line in ("time,u", "0,1", "1,2"))
    table = read(write, rows.replace(",", end))
    assert table.columns == ("time", "u")
    named = read(write, "0,1,\n1,2,\n", TableLayout(("time", "u")))
    np.testing.assert_array_equal(named.numbers("u"), [1, 2])


def test_a_table_without_names_says_how_to_give_them(write: Write) -> None:
    with pytest.raises(InputError, match="the columns have no names") as told:
        read(write, ROWS)
    assert told.value.hint == "give them: recording.columns=[time, u1, u2]"
    assert count_unnamed(write("r.csv", ROWS)) == 3
    assert count_unnamed(write("r.csv", "time,u,v\n" + ROWS)) == 0
    table = read(write, ROWS, TableLayout(("time", "a", "b [m]")))
    assert table.columns == ("time", "a", "b")
    assert table.units == {"b": "m"}
    assert len(table) == 2


def test_one_column_of_numbers_has_no_header(write: Write) -> None:
    text = "5.55\n5.05\n4.58\n"
    assert count_unnamed(write("r.csv", text)) == 1
    table = read(write, text, TableLayout(("v",)))
    np.testing.assert_array_equal(table.numbers("v"), [5.55, 5.05, 4.58])
    assert count_unnamed(write("r.csv", f"v\n{text}")) == 0


def test_a_list_of_names_replaces_the_header(write: Write) -> None:
    table = read(write, "x-axis,1,2\nsecond,Volt,Volt\n" + ROWS, TableLayout(("time", "u", "v")))
    assert table.columns == ("time", "u", "v")
    assert len(table) == 2


def test_columns_are_renamed(write: Write) -> None:
    layout = TableLayout(headers={"time": "Zeit", "T": "Temperature 1"})
    table = read(write, "Zeit (s),Temperature 1 (degC),v\n" + ROWS, layout)
    assert table.columns == ("time", "T", "v")
    assert table.units == {"time": "s", "T": "degC"}
    with pytest.raises(InputError, match="the recording has no column 'Zeitt'") as told:
        read(write, "Zeit,u,v\n" + ROWS, TableLayout(headers={"time": "Zeitt"}))
    assert told.value.hint == "did you mean Zeit?"


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("T (degC)", ("T", "degC")),
        ("Time(s)", ("Time", "s")),
        ("v [m/s]", ("v", "m/s")),
        ("T (C)", ("T", None)),
        ("T (indoor)", ("T (indoor)", None)),
        ("f(t)", ("f(t)", None)),
        ("(s)", ("(s)", None)),
        ("Level, m", ("Level", "m")),
        ("Pump, m3/h", ("Pump", "m3/h")),
        ("Temp, °C", ("Temp", "°C")),
        ("Date Time, GMT-05:00", ("Date Time, GMT-05:00", None)),
        ("Room, north", ("Room, north", None)),
        ("Room, 2", ("Room, 2", None)),
        (", m", (", m", None)),
        ("Temp, °C (LGR S/N: 10, SEN S/N: 7)", ("Temp", "°C")),
        ("Temp, C", ("Temp, C", None)),
    ],
)
def test_a_unit_may_stand_in_parentheses_or_after_a_comma(
    header: str, expected: tuple[str, str | None]
) -> None:
    assert split_header(header) == expected


def test_headers_that_are_used_or_would_be_the_same_stay_as_they_are(write: Write) -> None:
    table = read(write, "time,T (K),T (degC)\n" + ROWS)
    assert table.columns == ("time", "T (K)", "T (degC)")
    used = read(write, "time,T (K),v\n" + ROWS, TableLayout(used=("T (K)",)))
    assert used.columns == ("time", "T (K)", "v")


def test_rows_without_times_have_a_constant_step(write: Write, ode) -> None:
    text = "u,v\n" + "".join(f"{i % 7}.5,{i % 3}\n" for i in range(30))
    with pytest.raises(InputError, match="no column 'time'"):
        read_episodes(write("r.csv", text), None, ode)
    found = read_episodes(write("r.csv", text), None, ode, TableLayout(step=0.25))
    np.testing.assert_allclose(found.single("r").times, 0.25 * np.arange(30))


def test_the_column_with_the_times_is_suggested(write: Write, ode) -> None:
    text = "u,x-axis,v\n" + "".join(f"{i % 4},{0.1 * i},1\n" for i in range(30))
    with pytest.raises(InputError) as told:
        read_episodes(write("r.csv", text), None, ode)
    assert "recording.columns={time: x-axis}" in str(told.value.hint)


def test_the_column_of_the_episodes_is_suggested(write: Write, ode) -> None:
    rows = [f"{run},{0.1 * i},{i % 5}" for run in ("a", "b") for i in range(30)]
    path = write("r.csv", "\n".join(["Subject,time,u", *rows, ""]))
    with pytest.raises(InputError, match="start again, where 'Subject' changes") as told:
        read_episodes(path, None, ode)
    assert "if these are several episodes: recording.columns={episode: Subject}" in str(told.value)
    assert "recording.columns={sensor: Subject, value: COLUMN}" in str(told.value)
    found = read_episodes(path, None, ode, TableLayout(headers={"episode": "Subject"}))
    assert [episode.name for episode in found.episodes] == ["a", "b"]


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ("time", "neither a list nor a mapping"),
        ([], "neither a list nor a mapping"),
        (["time", ""], "'' is not the name of a column"),
        (["time", "u", "u"], "contains 'u' twice"),
        ({"time": 3.5}, "3.5 is not the name of a column"),
        ({"time": "t", "u": "t"}, "contains 't' twice"),
    ],
)
def test_columns_that_cannot_be_are_refused(columns: object, says: str) -> None:
    with pytest.raises(InputError, match=says):
        parse_columns(columns, "c.yaml:3")


FOOTERS = {
    "a sentence": "logger stopped\n",
    "blank lines": "\n\n,,\n",
    "another table": ",,\n,u,v\n,0.25,1.5\n~End,,\nOriginal file: a; saved: 2024,,\n",
    "a summary": "\nmean,1.4,2.5\n",
    "a table of peaks": "\n[Peaks]\nno,at,area,height\n1,0.05,4.25,1\n",
}
FIRST = {case: (4,) for case in FOOTERS} | {
    "blank lines": (),
    "another table": (5,),
    "a summary": (5,),
    "a table of peaks": (5,),
}


@pytest.mark.parametrize("case", FOOTERS)
def test_what_stands_below_the_rows_is_left_out(write: Write, case: str) -> None:
    table = read(write, "time,u,v\n" + ROWS + FOOTERS[case])
    np.testing.assert_array_equal(table.numbers("time"), [0.0, 0.1])
    assert table.others[:1] == FIRST[case]


def test_messages_between_rows_are_left_out(write: Write) -> None:
    text = "time;u;v;\n0;1;2;\nsensor error\n\n1;2;3;\ntime;u;v;\n2;3;4;\n"
    table = read(write, text)
    np.testing.assert_array_equal(table.numbers("u"), [1, 2, 3])
    assert table.others == (3, 6)
    assert table.location(1) == f"{table.path}:5"


def test_a_damaged_row_is_no_message(write: Write) -> None:
    for last in ("0.2x,1,2\n", ",1,2\n"):
        table = read(write, "time,u,v\n" + ROWS + last)
        assert len(table) == 3 and not table.others
    with pytest.raises(InputError, match=r"r.csv:3: the row has 1 cells") as told:
        read(write, "time,u,v\n0.0,1.5,2\n0.05\n0.1,1.25,3\n")
    assert "correct this line, or remove it" in str(told.value.hint)


@pytest.mark.parametrize("name", ["lake.wtr", "run.log", "readings"])
def test_any_text_is_read_as_a_table(write: Write, ode, name: str) -> None:
    lines = [f"2024-05-0{1 + i}\t{i}.5\t{i % 3}" for i in range(9)]
    path = write(name, "\n".join(["datetime\tu\tv", *lines, ""]))
    assert read_episodes(path, None, ode).single(path).names == ("u", "v")
    with pytest.raises(InputError, match="this is a binary file, and no table of text"):
        read_episodes(write("b.wtr", "time\tu\0\n"), None, ode)
