"""A part of a recording: numbers and dates as bounds, inputs that hold, and episodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from dashred.core.errors import InputError
from dashred.core.stated.record_part import RecordPart, parse_part
from dashred.data.io.in_memory import read_in_memory
from dashred.data.io.reader import read_episodes
from dashred.data.io.tables.table_layout import TableLayout
from dashred.data.io.write_netcdf import write_netcdf

TIMES = 0.1 * np.arange(40)


def layout(begin=None, end=None) -> TableLayout:
    return TableLayout(part=RecordPart(begin, end))


def table(times=TIMES, extra: str = "") -> str:
    rows = "".join(f"{t},{i},{-i}{extra}\n" for i, t in enumerate(times))
    return f"time,u,v{',power' if extra else ''}\n{rows}"


def test_both_bounds_belong_to_the_part_and_the_clock_remains(ode, write):
    path = write("r.csv", table())
    found = read_episodes(path, None, ode, layout(0.3, 2)).single(path)
    np.testing.assert_allclose(found.times, TIMES[3:21])
    np.testing.assert_array_equal(found.values[:, 0], np.arange(3, 21))
    assert len(read_episodes(path, None, ode, layout(end=1.5)).single(path).times) == 16


def test_a_netcdf_and_a_frame_are_cut_alike(ode, write, tmp_path):
    path = write("r.csv", table())
    whole = read_episodes(path, None, ode).single(path)
    cut = read_episodes(path, None, ode, layout(0.3, 2))
    write_netcdf(whole, tmp_path / "r.nc")
    again = read_episodes(str(tmp_path / "r.nc"), None, ode, layout(0.3, 2))
    assert again.sha256() == cut.sha256()
    frame = read_in_memory(pd.read_csv(path), None, ode, layout(0.3, 2))
    assert frame.sha256() == cut.sha256()
    with pytest.raises(InputError, match="the times of the recording are numbers"):
        read_episodes(str(tmp_path / "r.nc"), None, ode, layout("2024-05-17"))


@pytest.mark.parametrize(
    ("form", "begin"),
    [
        ("%Y-%m-%d %H:%M", "2024-05-31 23:30"),
        ("%Y/%m/%d %H:%M", "2024-05-31 23:30"),
        ("%Y-%m-%dT%H:%M:%S+02:00", "2024-05-31 23:30"),
        ("%d.%m.%Y %H:%M", "31.05.2024 23:30"),
        ("%d.%m.%Y %H:%M", "2024-05-31 23:30:00"),
        ("%m/%d/%Y %I:%M %p", "05/31/2024 11:30 PM"),
        ("%H:%M", "23:30"),
    ],
)
def test_a_bound_may_be_a_date(ode, write, form, begin):
    stamps = pd.date_range("2024-05-31 22:00", periods=40, freq="15min").strftime(form)
    path = write("r.csv", table(stamps))
    found = read_episodes(path, None, replace(ode, units={"t": "h"}), layout(begin))
    np.testing.assert_allclose(found.single(path).times, 1.5 + 0.25 * np.arange(34))
    with pytest.raises(InputError, match="'soon' is not a date"):
        read_episodes(path, None, ode, layout("soon"))


@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M", "%d.%m.%Y %H:%M"])
def test_a_date_alone_is_its_midnight(ode, write, form):
    stamps = pd.date_range("2024-05-31 22:00", periods=40, freq="15min")
    path = write("r.csv", table(stamps.strftime(form)))
    midnight = stamps[8].strftime(form.partition(" ")[0])
    found = read_episodes(path, None, ode, layout(end=midnight)).single(path)
    assert found.times[-1] == 7200


def test_an_input_keeps_its_value_from_before_the_part(ode, write):
    system = replace(ode, inputs={"e": "power"}, held_inputs=("power",))
    rows = [f"{t},{i},{-i},{7 if i == 2 else ''}\n" for i, t in enumerate(TIMES)]
    rows[0] = "0.0,0,0,5\n"
    path = write("r.csv", "time,u,v,power\n" + "".join(rows))
    found = read_episodes(path, None, system, layout(begin=1.0)).single(path)
    assert found.times[0] == pytest.approx(1)
    assert found.inputs.at(1.0)["power"] == 7


def test_gaps_of_an_input_outside_of_the_part_do_not_matter(ode, write, tmp_path):
    system = replace(ode, inputs={"e": "power"})
    empty = {*range(10), *range(30, 38)}
    rows = [f"{t},{i},{-i},{'' if i in empty else i}\n" for i, t in enumerate(TIMES)]
    path = write("r.csv", "time,u,v,power\n" + "".join(rows))
    with pytest.raises(InputError, match=r"no value between 2\.9 and 3\.8"):
        read_episodes(path, None, system)
    with pytest.raises(InputError, match=r"the inputs cover 1 to 3\.9"):
        read_episodes(path, None, system, layout(end=2.5))
    inside = layout(begin=1, end=2.9)
    found = read_episodes(path, None, system, inside)
    assert len(found.single(path).times) == 20
    write_netcdf(found.single(path), tmp_path / "r.nc")
    dataset = xr.load_dataset(tmp_path / "r.nc", engine="h5netcdf").isel(input_time=slice(5, None))
    dataset.to_netcdf(tmp_path / "s.nc", engine="h5netcdf")
    with pytest.raises(InputError, match="the inputs cover"):
        read_episodes(str(tmp_path / "s.nc"), None, system)
    read_episodes(str(tmp_path / "s.nc"), None, system, layout(begin=1.5))


def test_every_episode_is_cut_on_its_own_clock(ode, write):
    rows = [f"{run},{t},{t},1\n" for run, n in (("a", 40), ("b", 10)) for t in TIMES[:n]]
    path = write("r.csv", "episode,time,u,v\n" + "".join(rows))
    both = read_episodes(path, None, ode, layout(end=0.8))
    assert [len(part.recording.times) for part in both.episodes] == [9, 9]
    late = read_episodes(path, None, ode, layout(begin=2))
    assert [part.name for part in late.episodes] == ["a"]
    with pytest.raises(InputError, match="contains 3 samples of episode 'b': at least 6"):
        read_episodes(path, None, ode, layout(begin=0.7))


def test_a_part_without_samples_or_values_is_refused(ode, write):
    path = write("r.csv", table())
    with pytest.raises(InputError, match="from 9 to the end contains 0 samples") as told:
        read_episodes(path, None, ode, layout(begin=9))
    assert "runs from t = 0 to 3.9" in str(told.value.hint)
    rows = "".join(f"{t},{i},{i if i < 9 else ''}\n" for i, t in enumerate(TIMES))
    path = write("s.csv", "time,u,v\n" + rows)
    with pytest.raises(InputError, match="'v' has no values in the part from 1 to the end"):
        read_episodes(path, None, ode, layout(begin=1))


def test_each_sensor_needs_values_in_one_episode(ode, write):
    rows = [(run, t, run == 1) for run in (1, 2, 3) for t in TIMES]
    told = [f"{run},{t},{'' if alone else t},{t if alone else ''}\n" for run, t, alone in rows]
    path = write("e.csv", "episode,time,u,v\n" + "".join(told))
    for part in (layout(), layout(begin=1)):
        whole = read_episodes(path, None, ode, part)
        known = [~np.isnan(each.recording.values).all(axis=0) for each in whole.episodes]
        np.testing.assert_array_equal(known, [[False, True], [True, False], [True, False]])
    early = [f"4,{t},{t if t < 1 else ''},\n" for t in TIMES]
    path = write("l.csv", "episode,time,u,v\n" + "".join([*told, *early]))
    names = [each.name for each in read_episodes(path, None, ode, layout(begin=1)).episodes]
    assert names == ["1", "2", "3"]
    silent = "".join(f"{run},{t},{t},{t if run == 1 and t < 1 else ''}\n" for run, t, _ in rows)
    path = write("n.csv", "episode,time,u,v\n" + silent)
    with pytest.raises(InputError, match="'v' has no values in the part from 1 to the end"):
        read_episodes(path, None, ode, layout(begin=1))


@pytest.mark.parametrize(
    ("begin", "end", "says"),
    [
        (True, None, "recording.begin is not a time: True"),
        (None, [3], "recording.end is not a time"),
        (None, float("nan"), "recording.end is not a time"),
        (" ", None, "recording.begin is not a time"),
        (3, 3.0, "recording.end must be after recording.begin"),
    ],
)
def test_what_is_not_a_part_is_refused(begin, end, says):
    with pytest.raises(InputError, match=says) as told:
        parse_part(begin, end, "my.yaml, {}".format)
    assert str(told.value).startswith("my.yaml, recording.")
