"""Arbitrary files as recordings: refused with a location, or read as a valid recording."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
import pytest
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.core.files.plain_text import first_unprintable
from dashred.data.clocks.resampling import resample_all
from dashred.data.io.reader import read_episodes
from dashred.data.io.sensors_table import read_sensors
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.csv_table import read_table
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.physics.grids.grid import Axis
from tests.fuzz.examples import fuzzed


@dataclass(frozen=True)
class Swing:
    """An ODE system, with or without an input and units."""

    axes: tuple[Axis, ...] = ()
    fields: tuple[str, ...] = ("u", "v")
    lets: tuple[str, ...] = ("speed",)
    inputs: dict[str, str] = field(default_factory=dict)
    held_inputs: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    where: Callable[[str], str] = "a.yaml, {}".format

    def contains(self, place: Sequence[float], /) -> bool:
        """Every place is in the domain."""
        return True


RING = Swing((Axis("x", 2.0, 16),))
DRIVEN = Swing(inputs={"f": "f"}, units={"u": "m", "f": "N"})
HELD = Swing(inputs={"f": "f"}, held_inputs=("f",))
SYSTEMS = st.sampled_from([Swing(), DRIVEN, HELD])
NUMBERS = st.one_of(
    st.floats(width=32).map(repr),
    st.integers(-9, 9).map(str),
    st.sampled_from(
        ["", " ", "nan", "NaN", "inf", "-inf", "1e308", "-1e101", "5e-324", "1_0", "0x1"]
    ),
    st.sampled_from(["1,5", "1;5", "'1'", '"1"', "high", "\0", "٣", "1e999", "--1", "+1", "1."]),
)
HEADS = st.sampled_from(
    ["time", "u", "v", "speed", "episode", "f", "w", "", "u ", "\0", "u [m]", "f [N]"]
)
NAMES = st.sampled_from(["p0", "p1", "time", "../p", "", "<b>", "$x$", "p\0", "p\x1b[2J", "a\nb"])
WRITTEN = st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"])


def csv_of(head: list[str], rows: list[list[str]], end: str, codec: str) -> bytes:
    lines = [head, *rows]
    return end.join(",".join(line) for line in lines).encode(codec, "replace")


ROWS = st.lists(st.lists(NUMBERS, min_size=3, max_size=3), max_size=26)
STEPS = st.lists(st.sampled_from([0.1, 0.1, 0.1, 0.11, 1.0, 1e9, 0.0, -1.0, 1e-9]), min_size=20)


def steady(steps: list[float], cells: list[str]) -> list[list[str]]:
    """Return rows with mostly increasing times, so that later checks are reached, too."""
    times = np.cumsum(steps).tolist()
    return [[repr(t), repr(np.sin(t)), cells[i % len(cells)]] for i, t in enumerate(times)]


STEADY = st.builds(steady, STEPS, st.lists(NUMBERS | st.floats(-1, 1).map(repr), min_size=1))
TABLES = st.one_of(
    st.binary(max_size=80),
    st.text(max_size=80).map(str.encode),
    st.builds(csv_of, st.lists(HEADS, min_size=3, max_size=3), ROWS | STEADY,
              st.sampled_from(["\n", "\r\n", "\r"]), WRITTEN),
    st.builds(csv_of, st.sampled_from([["time", "u", "v"], ["time", "f", "u"], ["time", "u", "f"],
              ["time [s]", "f [N]", "u [m]"], ["time", "u [m]", "v"]]), STEADY, st.just("\n"),
              st.just("utf-8")),
)  # fmt: skip


@fuzzed(
    250,
    25_000,
    data=TABLES,
    system=SYSTEMS,
    every=st.none() | st.sampled_from([1e-300, 0.1, 0.2, 7.0, 1e300]),
)
def test_any_table_is_refused_or_a_recording(
    data: bytes, system: Swing, every: float | None
) -> None:
    Path("a.csv").write_bytes(data)
    try:
        read = read_episodes("a.csv", None, system)
        for episode in read.episodes:
            assert_sound(episode.recording)
        if len(read.episodes) == 1:
            assert_as_written(read.episodes[0].recording, data)
        sampled, says = resample_all(read, every)
        assert says
        for episode in sampled.episodes:
            assert np.all(np.diff(episode.recording.times) > 0)
            assert not np.isinf(episode.recording.values).any()
            assert np.all(noise_std(episode.recording) > 0)
    except InputError as error:
        assert "Traceback" not in str(error)


def assert_sound(recording: Recording) -> None:
    """Check the properties that the analysis relies on."""
    assert np.all(np.diff(recording.times) > 0) and np.isfinite(recording.times).all()
    assert not np.isinf(recording.values).any()
    assert np.isfinite(recording.trace_std()).all()
    assert len(set(recording.names)) == len(recording.names) > 0
    assert all(name and not first_unprintable(name) for name in recording.names)
    assert len(recording.sha256()) == 64


def assert_as_written(recording: Recording, data: bytes) -> None:
    """Every value equals its cell, and none is added or omitted."""
    lines = [line.split(",") for line in data.decode("utf-8-sig").splitlines() if line.strip()]
    names = [cell.partition("[")[0].strip() for cell in lines[0]]
    if "episode" in names or any('"' in cell for line in lines for cell in line):
        return
    # Other columns are not read, and may contain anything.
    read = {"time", *recording.names, *recording.inputs.values}
    columns = {
        name: np.array([float(line[j].strip() or "nan") for line in lines[1:]])
        for j, name in enumerate(names)
        if name in read
    }
    np.testing.assert_array_equal(recording.times, columns["time"])
    for name, values in zip(recording.names, recording.values.T, strict=True):
        np.testing.assert_array_equal(values, columns[name])
    for name, driven in recording.inputs.values.items():
        known = ~np.isnan(columns[name])
        at_its_rows = np.searchsorted(recording.inputs.times, columns["time"][known])
        np.testing.assert_array_equal(driven[at_its_rows], columns[name][known])


SENSOR_ROWS = st.lists(st.tuples(NAMES, HEADS, NUMBERS, NUMBERS).map(list), max_size=5)
SENSOR_HEADS = st.permutations(["name", "field", "x", "std"]) | st.lists(HEADS, max_size=4)


@fuzzed(
    150,
    10_000,
    head=SENSOR_HEADS,
    rows=SENSOR_ROWS,
    raw=st.binary(max_size=60),
    plain=st.booleans(),
)
def test_any_table_of_sensors_is_refused_or_sound(
    head: list[str], rows: list[list[str]], raw: bytes, plain: bool
) -> None:
    Path("s.csv").write_bytes(csv_of(head, rows, "\n", "utf-8") if plain else raw)
    try:
        sensors = read_sensors(read_table("s.csv"), RING, StatedUnits(RING))
    except InputError as error:
        assert "s.csv" in str(error)
        return
    assert sensors and len({sensor.name for sensor in sensors}) == len(sensors)
    for sensor in sensors:
        assert not first_unprintable(sensor.name) and sensor.reads in ("u", "v", "speed")
        assert all(0 <= place <= 2 for place in sensor.position) and len(sensor.position) == 1
        assert sensor.std is None or 0 < sensor.std < np.inf


KINDS = st.sampled_from(["f8", "f4", "i8", "u1", "S3", "c16", "bool", "O"])
SHAPES = st.sampled_from([(25,), (2,), (25, 2), (2, 25), (), (0,), (25, 0), (10**13,)])
PARTS = st.dictionaries(
    st.sampled_from(["time", "value", "name", "reads", "std", "x", "input_time", "episode"]),
    st.tuples(KINDS, SHAPES, st.sampled_from([0.0, 1.0, np.nan, np.inf, 1e300])),
)


@fuzzed(8, 2_500, parts=PARTS, cut=st.integers(0, 12_000), raw=st.binary(max_size=60))
def test_any_netcdf_is_refused_or_a_recording(
    parts: dict[str, tuple[str, tuple[int, ...], float]], cut: int, raw: bytes
) -> None:
    """Variables of any shape and type, truncated files, and files that are not NetCDF."""
    with h5py.File("a.nc", "w") as file:
        for name, (kind, shape, value) in parts.items():
            written(file, name, kind, shape, value)
    whole = Path("a.nc").read_bytes()
    Path("a.nc").write_bytes(raw if not cut else whole[:cut] if cut < 6_000 else whole)
    try:
        for episode in read_episodes("a.nc", None, RING).episodes:
            assert_sound(episode.recording)
    except InputError as error:
        assert "a.nc" in str(error)


def written(file: Any, name: str, kind: str, shape: tuple[int, ...], value: float) -> None:
    """Write one variable; a huge one is only declared."""
    if kind == "O":
        texts = np.full(shape if np.prod(shape) < 100 else (2,), "u", dtype=object)
        file.create_dataset(name, data=texts, dtype=h5py.string_dtype())
    elif shape == (10**13,):
        file.create_dataset(name, shape, dtype="f8", chunks=(1000,))
    else:
        # A number too large for its type is stored as infinity.
        with np.errstate(over="ignore"):
            filled = np.full(shape, value if kind.startswith(("f", "c")) else 1).astype(kind)
        file.create_dataset(name, data=filled)


@pytest.mark.parametrize("ending", ["csv", "nc"])
@pytest.mark.parametrize("made", ["pipe", "folder", "device", "nothing"])
def test_what_is_no_file_is_refused_at_once(made: str, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    if made == "pipe":
        os.mkfifo(path)
    elif made == "folder":
        path.mkdir()
    elif made == "device":
        path.symlink_to("/dev/zero")
    with pytest.raises(InputError, match=r"a\.(csv|nc)"):
        read_episodes(str(path), None, Swing())
