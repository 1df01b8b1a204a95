"""The column of the times, by name and by content: numbers, dates and times of day."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from dashred.core.errors import InputError
from dashred.data.io.in_memory import read_in_memory
from dashred.data.io.reader import read_episodes, read_recording
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.csv_table import read_table
from dashred.data.io.tables.dates import CLOCK_FORMAT, is_date, seconds_until
from dashred.data.io.tables.table_layout import TableLayout
from dashred.data.io.tables.time_column import find_time_column, likely_times, read_times

Write = Callable[[str, str], str]
QUARTERS = 900.0 * np.arange(24)


def times(write: Write, system: Any, text: str) -> np.ndarray:
    table = read_table(write("r.csv", text))
    return read_times(table, find_time_column(table), StatedUnits(system)).values


def column(name: str, cells: list[str]) -> str:
    return "\n".join([f"{name};u", *(f"{cell};1" for cell in cells)]) + "\n"


def stamps(form: str, begin: str = "2024-05-31 22:00") -> list[str]:
    return list(pd.date_range(begin, periods=24, freq="15min").strftime(form))


@pytest.mark.parametrize(
    ("name", "unit"),
    [("millis", "ms"), ("t_s", "s"), ("Time_ms", "ms"), ("elapsed_min", "min"), ("hours", "h")],
)
def test_a_name_may_say_the_unit(write: Write, ode: Any, name: str, unit: str) -> None:
    table = read_table(write("r.csv", column(name, ["0", "500", "2000"])))
    stated = StatedUnits(ode)
    read_times(table, find_time_column(table), stated)
    assert stated.units == {"t": unit}
    # A name without a unit comes first, and T_s is a temperature.
    other = read_table(write("r.csv", f"{name};t;T_s\n0;1;20\n1;2;20\n"))
    assert find_time_column(other).columns == ("t",)


@pytest.mark.parametrize("name", ["time", "Time", "TIME", "t", "Timestamp", "datetime", "Date"])
def test_the_column_is_found_by_its_name(write: Write, ode: Any, name: str) -> None:
    found = times(write, ode, column(name, ["0", "0.5", "2"]))
    np.testing.assert_array_equal(found, [0.0, 0.5, 2.0])


FORMATS = [
    *("%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%SZ", "%Y-%m-%d %H:%M", "%Y/%m/%d %H:%M:%S.%f"),
    *("%d.%m.%Y %H:%M", "%d.%m.%y %H:%M:%S", "%d/%m/%Y %H:%M", "%m/%d/%Y %I:%M %p"),
    *("%m/%d/%Y %I:%M:%S %p", "%d-%m-%Y %H:%M:%S", "%H:%M:%S", "%H:%M"),
    *("%d-%b-%y %H:%M", "%d %B %Y %H:%M:%S"),
]


@pytest.mark.parametrize("form", FORMATS)
def test_dates_are_seconds_since_the_first_row(write: Write, ode: Any, form: str) -> None:
    """From the last day of a month into the next one, past midnight."""
    found = times(write, ode, column("Timestamp", stamps(form)))
    np.testing.assert_allclose(found, QUARTERS)


def test_a_month_may_have_its_name(write: Write, ode: Any) -> None:
    """As spreadsheets write it, in an order that is certain."""
    found = times(write, ode, column("date", ["31-May-17", "1-Jun-17", "2-Jun-17"]))
    np.testing.assert_array_equal(found, 86400.0 * np.arange(3))
    assert not is_date("3 big 20") and not is_date("1-Jul")


def test_dates_have_the_digits_of_their_fractions(write: Write, ode: Any) -> None:
    cells = [f"2024-05-31 23:59:59.{k}0007" for k in range(10)]
    found = times(write, ode, column("time", cells))
    np.testing.assert_allclose(found, 0.1 * np.arange(10), rtol=0, atol=1e-12)


def test_the_order_of_day_and_month_need_not_be_known_within_a_day(write: Write, ode: Any) -> None:
    cells = [f"03/04/2024 1{k}:00" for k in range(4)]
    np.testing.assert_array_equal(times(write, ode, column("t", cells)), 3600.0 * np.arange(4))


def test_date_and_time_in_two_columns_are_joined(write: Write, ode: Any) -> None:
    rows = [stamp.replace(" ", ";") for stamp in stamps("%d.%m.%Y %H:%M:%S")]
    found = times(write, ode, column("Date;Time", rows))
    np.testing.assert_allclose(found, QUARTERS)


@pytest.mark.parametrize(("unit", "seconds"), [("min", 60), ("h", 3600), ("d", 86400), ("s", 1)])
def test_the_unit_is_that_of_the_system(write: Write, ode: Any, unit: str, seconds: int) -> None:
    system = replace(ode, units={"t": unit})
    found = times(write, system, column("time", stamps("%Y-%m-%d %H:%M")))
    np.testing.assert_allclose(found, QUARTERS / seconds)


@pytest.mark.parametrize("last", ["24:15:00", "1.00:15:00", "1 day, 0:15:00", "1 days 00:15:00.0"])
def test_a_clock_may_count_beyond_a_day(write: Write, ode: Any, last: str) -> None:
    found = times(write, ode, column("Time", ["0:00:00", "12:30:00", "23:45:00", last]))
    np.testing.assert_array_equal(found, 900.0 * np.array([0, 50, 95, 97]))
    assert seconds_until(last, "0:00:00", CLOCK_FORMAT) == 97 * 900
    assert seconds_until("1:00", "23:00", CLOCK_FORMAT) == 7200


def test_a_time_zone_counts(write: Write, ode: Any) -> None:
    """Clocks are put back at the end of summer time."""
    cells = ["2024-10-27T02:30:00+02:00", "2024-10-27T02:00:00+01:00", "2024-10-27T02:30:00+01:00"]
    np.testing.assert_array_equal(times(write, ode, column("time", cells)), [0, 1800, 3600])


REFUSED = {
    "a day or a month": (
        ["03/04/2024 00:00", "04/05/2024 00:00", "05/06/2024 00:00"],
        "is the day or the month first?",
    ),
    "not a date": (["2024-05-17 12:30", "noon"], "r.csv:3, column 'time': 'noon' is not a date"),
    "another form": (["17.05.2024", "2024-05-18"], "'2024-05-18' is not a date like the first"),
    "no such day": (["30.02.2024", "01.03.2024"], "'30.02.2024' is not a date"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_other_dates_are_refused(write: Write, ode: Any, case: str) -> None:
    cells, message = REFUSED[case]
    with pytest.raises(InputError) as caught:
        times(write, ode, column("time", cells))
    assert message in str(caught.value)


def test_dates_need_a_unit_of_time(write: Write, ode: Any) -> None:
    system = replace(ode, units={"t": "fortnight"})
    with pytest.raises(InputError, match="the unit of time is 'fortnight'"):
        times(write, system, column("time", stamps("%Y-%m-%d %H:%M")))


def test_an_empty_cell_is_reported_at_its_column(write: Write, ode: Any) -> None:
    cells = stamps("%Y-%m-%d %H:%M")
    cells[7] = ""
    with pytest.raises(InputError, match=r"r.csv:9, column 'Timestamp': the time is missing"):
        read_recording(write("r.csv", column("Timestamp", cells)), None, ode)


def test_a_data_frame_with_dates(ode: Any) -> None:
    clock = pd.date_range("2024-05-31 22:00", periods=24, freq="15min")
    frame = pd.DataFrame({"time": clock, "u": np.arange(24.0)})
    recording = read_in_memory(frame, None, ode, TableLayout()).single("recording")
    np.testing.assert_allclose(recording.times, QUARTERS)
    assert recording.units == {"t": "s"}


@pytest.mark.parametrize("form", ["%m/%d/%y %I:%M:%S %p", "%Y-%m-%d %H:%M", "%d.%m.%Y %H:%M"])
def test_dates_are_likelier_times_than_a_count_of_the_rows(write: Write, form: str) -> None:
    rows = [f"{i};{cell};{20 - i}" for i, cell in enumerate(stamps(form))]
    table = read_table(write("r.csv", "\n".join(["no;Date Time, GMT-05:00;T", *rows]) + "\n"))
    assert likely_times(table) == "Date Time, GMT-05:00"


def test_a_date_that_stays_is_no_time(write: Write) -> None:
    rows = [f"2024-05-31;{0.1 * i};1" for i in range(24)]
    table = read_table(write("r.csv", "\n".join(["day;elapsed;T", *rows]) + "\n"))
    assert likely_times(table) == "elapsed"


@pytest.mark.parametrize("form", ["%m/%d/%y %I:%M:%S %p", "%d/%m/%Y %H:%M"])
def test_the_day_is_what_changes_at_midnight(write: Write, ode: Any, form: str) -> None:
    found = times(write, ode, column("time", stamps(form, "2024-06-01 22:00")))
    np.testing.assert_allclose(found, QUARTERS)


def test_times_that_a_logger_rounds_are_found_by_their_unit(write: Write) -> None:
    table = read_table(write("r.csv", "T (degC),Tiempo (s)\n20,0.1\n21,0.1\n22,0.2\n23,0.3\n"))
    assert likely_times(table) == "Tiempo"
    # Two columns in a unit of time say nothing; numbers that always increase do.
    table = read_table(write("s.csv", "n,rise (s),fall (s)\n1,0,0\n2,0,0\n3,1,1\n"))
    assert likely_times(table) == "n"


def test_a_column_that_is_ignored_has_no_times(write: Write, ode: Any) -> None:
    rows = [f"{0.03 * i:.1f},{np.cos(i)}" for i in range(20)]
    path = write("r.csv", "\n".join(["t,u", *rows, ""]))
    layout = TableLayout(step=0.03, ignored=("t",))
    found = read_episodes(path, None, ode, layout).single("r")
    np.testing.assert_allclose(found.times, 0.03 * np.arange(20))


def test_rounded_times_get_an_even_clock(write: Write, ode: Any) -> None:
    rows = [f"{0.008 * i:.2f},{np.cos(i)}" for i in range(100)]
    found = read_episodes(write("r.csv", "\n".join(["t,u", *rows, ""])), None, ode)
    assert found.is_rounded
    np.testing.assert_allclose(found.single("r").times, 0.008 * np.arange(100), atol=0.005)
    even = read_episodes(write("r.csv", "\n".join(["t,u", *rows[::2], ""])), None, ode)
    assert not even.is_rounded
