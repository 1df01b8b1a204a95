"""Arbitrary files of loggers: refused, or read as a valid recording, and given names by init."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.core.stated.column_names import parse_columns
from dashred.data.io.reader import read_episodes
from dashred.data.io.tables.table_layout import TableLayout
from dashred.pipeline.init.columns import read_recording
from dashred.pipeline.init.guessed_system import ChosenColumns
from tests.fuzz.examples import fuzzed


@dataclass(frozen=True)
class Tank:
    """An ODE system with an input."""

    axes: tuple[Any, ...] = ()
    fields: tuple[str, ...] = ("u", "T")
    lets: tuple[str, ...] = ()
    inputs: dict[str, str] = field(default_factory=lambda: {"q": "Heater 1 (%)"})
    held_inputs: tuple[str, ...] = ("Heater 1 (%)",)
    units: dict[str, str] = field(default_factory=dict)
    where = "a.yaml, {}".format

    def contains(self, place: Sequence[float], /) -> bool:
        """Every place is in the domain."""
        return True


NAMES = st.sampled_from(
    ["time", "Time (s)", "t", "T", "u", "T (degC)", "Heater 1 (%)", "x-axis", "Subject", "1", "",
     "date", "rownames", "sensor", "value", "u [m", "Größe", "lambda", "(s)", '"u, v"', "episode",
     '"u, m"', "#", '"T, °C (S/N: 1, LBL: a)"', '"Date Time, GMT-05:00"', '"u, 1"', '", m"']
)  # fmt: skip
LINES = st.sampled_from(
    ["A logger", '"TOA5","a","b"', "# comment", "", "second,volt,-", "s;V;V", "Run #1,Run #1,u",
     "Run 1,,Run 2,", "#t u T", '"', "\t\t", ",,", "0,1", "\0", "2024-05-01 12:00"]
)  # fmt: skip
CELLS = st.sampled_from(
    ["", "1", "-2.5", "1,5", "nan", "inf", "a", "12:30:00", "2024-05-01", "1e400"]
)
CLOCKS = st.sampled_from(["{:.1f}", "2024-05-01 00:{:02.0f}", "{:.0f}:00:00", "{:.0f}", "x{:.0f}",
                          "06/{:02.0f}/24 01:00 PM", "06/01/24 {:02.0f}:00"])  # fmt: skip
COLUMNS = st.one_of(
    st.none(),
    st.lists(NAMES, min_size=1, max_size=4),
    st.dictionaries(
        st.sampled_from(["time", "u", "T", "episode", "q", "sensor", "value"]), NAMES, max_size=3
    ),
)


def logged(
    before: list[str], names: list[str], below: list[str], clock: str, cells: list[str],
    count: int, separator: str, end: str,
) -> str:  # fmt: skip
    """Return a file with lines about its header, and rows with increasing times."""
    rows = [
        separator.join([clock.format(i), f"{np.sin(0.3 * i):.3f}", cells[i % len(cells)]]) + end
        for i in range(count)
    ]
    header = [separator.join(names) + end] if names else []
    return "\n".join([*before, *header, *below, *rows, ""])


FILES = st.builds(
    logged,
    st.lists(LINES, max_size=3),
    st.lists(NAMES, min_size=3, max_size=3) | st.just([]) | st.lists(NAMES, max_size=4),
    st.lists(LINES, max_size=2),
    CLOCKS,
    st.lists(CELLS, min_size=1, max_size=5),
    st.integers(0, 40),
    st.sampled_from([",", ";", "\t", " "]),
    st.sampled_from(["", "", ",", "\t"]),
)


def shaped(
    labels: list[str], names: list[str], sensors: list[str], cells: list[str], count: int
) -> str:
    """Return runs side by side, or, without labels, one row for each reading."""
    spread = [label for label in labels for _ in names]
    width = len(names) * max(1, len(labels)) if labels else 3
    header = names * len(labels) if labels else ["time", *names][:3]
    rows = []
    for i in range(count):
        row = [cells[(i + k) % len(cells)] for k in range(width)]
        if labels:
            row[:: len(names)] = [str(i)] * len(labels)
        else:
            row[:2] = [str(i // len(sensors)), sensors[i % len(sensors)]]
        rows.append(row)
    lines = [spread, header, *rows] if labels else [header, *rows]
    return "\n".join([*map(",".join, lines), ""])


SHAPES = st.builds(
    shaped,
    st.lists(st.sampled_from(["Run 1", "Run 2", "Cup A", "u", ""]), max_size=3),
    st.lists(NAMES, min_size=2, max_size=3),
    st.lists(st.sampled_from(["u", "T", "T (degC)", "1:", "", "a b", "time"]), min_size=1),
    st.lists(CELLS, min_size=1, max_size=7),
    st.integers(0, 40),
)


@fuzzed(
    250,
    25_000,
    text=FILES | SHAPES,
    columns=COLUMNS,
    step=st.sampled_from([None, 0.5]),
    ignored=st.lists(NAMES, max_size=1),
)
def test_the_file_of_a_logger_is_refused_or_a_recording(
    text: str,
    columns: Sequence[str] | Mapping[str, str] | None,
    step: float | None,
    ignored: list[str],
) -> None:
    Path("a.csv").write_text(text, encoding="utf-8")
    try:
        names, headers = parse_columns(columns, "a.yaml")
        layout = TableLayout(names, headers, ignored, step)
        for episode in read_episodes("a.csv", None, Tank(), layout).episodes:
            recording = episode.recording
            assert np.all(np.diff(recording.times) > 0) and np.isfinite(recording.times).all()
            assert set(recording.names) <= {"u", "T"}
            assert not np.isinf(recording.values).any()
    except InputError as error:
        assert "Traceback" not in str(error)


@fuzzed(150, 10_000, text=FILES | SHAPES, inputs=st.lists(NAMES, max_size=1))
def test_init_refuses_a_file_or_names_its_columns(text: str, inputs: list[str]) -> None:
    Path("a.csv").write_text(text, encoding="utf-8")
    try:
        guessed, recordings, _ = read_recording("a.csv", None, ChosenColumns(inputs))
        assert guessed.fields and recordings
        assert len({*guessed.fields, *guessed.inputs}) == len(guessed.fields) + len(guessed.inputs)
    except InputError as error:
        assert "Traceback" not in str(error)
