"""Recordings of several episodes in CSV and NetCDF: round trip and errors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.data.clocks.resampling import resample_all
from dashred.data.episodes import Episode, Episodes, split_into_episodes
from dashred.data.io.reader import read_episodes, read_recording
from dashred.data.io.write_netcdf import write_netcdf
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.physics.backends.input_signals import InputSignals

MANY = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
SENSORS = (Sensor("u", "u"), Sensor("v", "v"))
NAMES = st.text("abcxyz019-_ é", min_size=1, max_size=6).map(str.strip).filter(bool)
VALUES = st.floats(-1e6, 1e6) | st.just(math.nan)


@st.composite
def several(draw, inputs=False):
    """Draw episodes with different lengths, starts, irregular steps and missing values."""
    parts: list[Episode] = []
    for name in draw(st.lists(NAMES, min_size=1, max_size=4, unique=True)):
        count = draw(st.integers(20, 30))
        steps = draw(st.lists(st.floats(0.01, 10), min_size=count, max_size=count))
        times = draw(st.floats(-100, 100)) + np.cumsum(steps)
        values = np.array(draw(st.lists(st.tuples(VALUES, VALUES), min_size=count, max_size=count)))
        # Each sensor has a value, and enough rows have a reading.
        values[:6] = 1.0
        force = {"force": np.linspace(0, len(parts), count)} if inputs else {}
        parts.append(Episode(name, Recording(SENSORS, times, values, InputSignals(times, force))))
    return Episodes(tuple(parts))


def as_csv(episodes: Episodes) -> str:
    lines = ["episode,v,time,u,force"]
    for part in episodes.episodes:
        force = part.recording.inputs.values["force"]
        for t, (u, v), f in zip(part.recording.times, part.recording.values, force, strict=True):
            shown = ["" if math.isnan(x) else repr(float(x)) for x in (v, t, u, f)]
            lines.append(",".join([part.name, *shown]))
    return "\n".join(lines) + "\n"


def assert_same(read: Episodes, given: Episodes) -> None:
    assert [part.name for part in read.episodes] == [part.name for part in given.episodes]
    for one, other in zip(read.episodes, given.episodes, strict=True):
        mine = one.recording.select(["u", "v"])
        np.testing.assert_array_equal(mine.times, other.recording.times)
        np.testing.assert_array_equal(mine.values, other.recording.values)
        np.testing.assert_array_equal(
            one.recording.inputs.values["force"], other.recording.inputs.values["force"]
        )


def with_readings(part: Episode) -> Episode:
    """Return an episode without the rows that contain an input alone; the input keeps them."""
    seen = ~np.isnan(part.recording.values).all(axis=1)
    times, values = part.recording.times[seen], part.recording.values[seen]
    return Episode(part.name, replace(part.recording, times=times, values=values))


@MANY
@given(episodes=several(inputs=True))
def test_a_table_of_episodes_is_read_as_it_was_written(ode, write, episodes):
    driven = replace(ode, inputs={"f": "force"})
    read = read_episodes(write("r.csv", as_csv(episodes)), None, driven)
    assert_same(read, Episodes(tuple(map(with_readings, episodes.episodes))))


@MANY
@given(episodes=several(inputs=True))
def test_a_netcdf_of_episodes_is_read_as_it_was_written(ode, tmp_path, episodes):
    write_netcdf(episodes, tmp_path / "r.nc")
    read = read_episodes(str(tmp_path / "r.nc"), None, replace(ode, inputs={"f": "force"}))
    assert_same(read, episodes)
    assert read.sha256() == episodes.sha256()


@MANY
@given(labels=st.lists(st.sampled_from(["a", "b", "c", ""]), max_size=12))
def test_stretches_hold_every_row_once_under_its_own_label_or_are_refused(labels):
    try:
        found = split_into_episodes(labels, str)
    except InputError:
        begins = [x for i, x in enumerate(labels) if i == 0 or labels[i - 1] != x]
        assert "" in labels or len(set(begins)) < len(begins)
        return
    assert [row for part in found for row in range(len(labels))[part.rows]] == [*range(len(labels))]
    for part in found:
        assert set(labels[part.rows]) == {part.name}


def test_one_episode_is_a_recording_like_any_other(ode, write):
    rows = [f"{i / 10},{math.sin(i)},1" for i in range(30)]
    plain = write("p.csv", "\n".join(["time,u,v", *rows]))
    named = write("n.csv", "\n".join(["time,u,v,episode", *(f"{row},run 7" for row in rows)]))
    assert read_recording(plain, None, ode).sha256() == read_episodes(named, None, ode).sha256()
    assert read_recording(named, None, ode).sha256() == read_episodes(plain, None, ode).sha256()


def test_several_episodes_are_refused_where_one_is_expected(ode, write):
    rows = [f"{i},{i // 20},1" for i in range(40)]
    with pytest.raises(InputError, match="2 episodes, but one is expected"):
        read_recording(write("r.csv", "\n".join(["time,episode,u", *rows])), None, ode)


def of(name: str, begin: float, step: float, count: int) -> Episode:
    times = begin + step * np.arange(count, dtype=np.float64)
    return Episode(name, Recording((Sensor("u", "u"),), times, times[:, None].copy()))


def test_each_episode_keeps_its_own_clock_and_all_have_one_step():
    episodes = Episodes((of("a", 60.0, 0.1, 40), of("b", 0.0, 0.2, 30)))
    sampled, says = resample_all(episodes, None)
    a, b = (part.recording for part in sampled.episodes)
    np.testing.assert_allclose(a.times, 60 + 0.2 * np.arange(20))
    np.testing.assert_allclose(b.times, 0.2 * np.arange(30))
    np.testing.assert_allclose(a.values[:, 0], a.times)
    assert says.startswith("a: took one sample of every 2") and "b: kept samples" in says


def test_a_step_that_leaves_too_little_of_an_episode_is_refused():
    episodes = Episodes((of("a", 0.0, 0.1, 100), of("b", 0.0, 0.1, 25)))
    with pytest.raises(InputError, match=r"episode 'b': a step of 0\.5 leaves 5 samples"):
        resample_all(episodes, 0.5)
    sampled, _ = resample_all(episodes, 0.2)
    assert [len(part.recording.times) for part in sampled.episodes] == [50, 13]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"episode": ("time", np.full(40, 0.5))}, "must hold names or integers"),
        ({"episode": ("sensor", ["a"])}, "'episode' has the dimensions"),
        ({"episode": ("time", ["a"] * 20 + ["b"] * 10 + ["a"] * 10)}, "sample 31, 'episode'"),
        (
            {"episode": ("time", [1] * 20 + [2] * 5 + [3] * 15)},
            "episode '2': 5 samples are too few",
        ),
    ],
)
def test_a_netcdf_with_odd_episodes_is_refused_where_it_is_odd(ode, tmp_path, change, message):
    import xarray as xr

    episodes = Episodes((of("a", 5.0, 1.0, 20), of("b", 0.0, 1.0, 20)))
    write_netcdf(episodes, tmp_path / "r.nc")
    with xr.open_dataset(tmp_path / "r.nc", engine="h5netcdf", decode_times=False) as dataset:
        changed = dataset.load().drop_vars("episode").assign(change)
    changed.to_netcdf(tmp_path / "odd.nc", engine="h5netcdf")
    with pytest.raises(InputError, match=message):
        read_episodes(str(tmp_path / "odd.nc"), None, ode)
