"""Tables of other shapes: one row for each reading, and groups of columns for each run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.data.io.tables.recording_table import read_recording_table
from dashred.data.io.tables.table_layout import TableLayout
from dashred.physics.system import System
from dashred.pipeline.init import command
from dashred.pipeline.input.read_recorded import read_recorded

TIMES = 0.5 * np.arange(16)


def written(folder: Path, text: str, *words: str) -> dict[str, object]:
    """Return the columns and the fields of the configuration of a table."""
    path, output = folder / "r.csv", folder / "mine.yaml"
    path.write_text(text)
    assert command.main([f"path={path}", f"output={output}", *words]) == 0
    config = load_config([f"conf={output}"], entry="train")
    return {"columns": config.recording.columns, "fields": [*config.system.fields]}


def readings(label: str, value: str, *, by_time: bool) -> str:
    """Return a table of two sensors; ``e`` is the share of the reading that is its error."""
    rows = [f"{t},{name},{np.sin(t + s)},0.{3 + s}" for s, name in enumerate("ab") for t in TIMES]
    rows = sorted(rows, key=lambda row: float(row.split(",")[0])) if by_time else rows
    return "\n".join([f"t,{label},{value},e", *rows, ""])


@pytest.mark.parametrize(
    ("label", "value", "by_time"),
    [("channel", "value", True), ("channel", "value", False), ("what", "reading", False)],
)
def test_a_header_tells_that_rows_are_readings(
    tmp_path: Path, label: str, value: str, by_time: bool
) -> None:
    found = written(tmp_path, readings(label, value, by_time=by_time))
    assert found == {"columns": {"sensor": label, "value": value}, "fields": ["a", "b"]}


def test_sensors_that_take_turns_are_recognised_without_a_header(tmp_path: Path) -> None:
    rows = [f"{0.1 * i:.1f} {1 + i % 3}: {np.sin(0.1 * i):.3f}" for i in range(60)]
    found = written(tmp_path, "\n".join([*rows, ""]))
    own = {"time": "1", "sensor": "2", "value": "3"}
    assert found["columns"] == {**own, "u_1": "1:", "u_2": "2:", "u_3": "3:"}
    assert found["fields"] == ["u_1", "u_2", "u_3"]


def test_a_column_that_tells_the_runs_apart_is_the_episode(tmp_path: Path) -> None:
    rows = [f"{run},{t},{name},{t}" for run in (1, 2) for name in "ab" for t in TIMES]
    found = written(tmp_path, "\n".join(["subject,time,sensor,value", *rows, ""]))
    assert found["columns"] == {"episode": "subject", "sensor": "sensor", "value": "value"}


def test_a_state_of_the_system_is_no_sensor_and_said_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{t},{'on' if t < 4 else 'off'},{np.sin(t):.3f}" for t in TIMES]
    found = written(tmp_path, "\n".join(["time,heater,T1", *rows, ""]))
    assert found == {"columns": None, "fields": ["T1"]}
    said = capsys.readouterr().out
    assert "left out: heater (text). If one names the sensor of each row" in said


@pytest.mark.parametrize(("label", "columns"), [("Run", None), ("Cup", {"episode": "Cup 1"})])
def test_runs_side_by_side_are_episodes(
    tmp_path: Path, label: str, columns: object, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{t},{np.sin(t):.3f},{t},{np.cos(t):.3f}" for t in TIMES]
    head = f"{label} 1,,{label} 2,\nTime (s),x,Time (s),x"
    found = written(tmp_path, "\n".join([head, *rows, ""]))
    assert found == {"columns": columns, "fields": ["x"]}
    said = "the groups of columns, Cup 1, Cup 2, are read as episodes" in capsys.readouterr().out
    assert said == (columns is not None)


def test_one_column_for_each_subject_is_an_episode_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{t},{np.sin(t):.3f},{'' if t == 2 else np.cos(t)}" for t in TIMES]
    table = "\n".join(["Time (h),Subject 1 (mg/L),Subject 2 (mg/L)", *rows, ""])
    found = written(tmp_path, table)
    assert found == {"columns": {"episode": "Subject 1"}, "fields": ["response"]}
    assert "Subject 1, Subject 2, are read as episodes" in capsys.readouterr().out
    config = load_config([f"conf={tmp_path / 'mine.yaml'}"], entry="train")
    layout = TableLayout(headers=config.recording.columns)
    read = read_recording_table(str(tmp_path / "r.csv"), layout)
    assert len(read) == 31 and read.units == {"Time": "h", "response": "mg/L"}


def test_names_within_the_cells_are_told(tmp_path: Path) -> None:
    path = tmp_path / "r.txt"
    path.write_text("".join(f"14:21:{i:02d}.123 -> T:8{i}.5 A:21.9\n" for i in range(16)))
    with pytest.raises(InputError, match=r"number alone, 81\.5 in place of T:81\.5"):
        command.main([f"path={path}", f"output={tmp_path / 'mine.yaml'}"])


def test_a_date_and_a_time_of_day_are_found_by_their_cells(tmp_path: Path) -> None:
    rows = [f"{np.sin(i):.3f};{1 + i // 8}.3.2026;{2 * (i % 8):02d}:30:00" for i in range(16)]
    found = written(tmp_path, "\n".join(["Pegel;Datum;Uhrzeit", *rows, ""]))
    assert found == {"columns": {"date": "Datum", "time": "Uhrzeit"}, "fields": ["Pegel"]}


def test_a_plate_reader_s_export_is_read_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Lines of settings, 96 wells, a clock that counts days, and the reader's own fits below."""
    wells = [f"{row}{column}" for row in "ABCDEFGH" for column in range(1, 13)]
    ends = "," * len(wells)
    clock = [f"{'1.' if i > 95 else ''}{i // 4 % 24}:{15 * (i % 4):02d}:00" for i in range(97)]
    rows = [
        ",".join([now, "37", *(f"{0.1 + 0.01 * i * (1 + w % 3):.4f}" for w in range(96))])
        for i, now in enumerate(clock)
    ]
    settings = [f"##BLOCKS= 1,{ends}", f"Plate:,Plate1{ends}"]
    header = ",".join(["Time", "Temperature(°C)", *wells])
    fits = [f",{ends}", ",".join(["", "", *wells]), f"~End,{ends}", f"Original Filename: a,{ends}"]
    path = tmp_path / "plate.csv"
    path.write_text("\n".join([*settings, header, *rows, *fits, ""]))
    with pytest.raises(InputError, match="96 columns besides time are too many") as wide:
        command.main([f"path={path}", f"output={tmp_path / 'mine.yaml'}"])
    assert "choose some of them: fields=A1,A2" in str(wide.value.hint)
    assert command.main([f"path={path}", f"output={tmp_path / 'mine.yaml'}", "fields=B2,H12"]) == 0
    told = capsys.readouterr().out
    assert "left out: 3 lines, the first is line 102 (not a row of the table)" in told
    config = load_config([f"conf={tmp_path / 'mine.yaml'}"], entry="train")
    assert [*config.system.fields] == ["B2", "H12"] and config.recording.columns is None
    read = read_recorded(config, System(config.system, config.where)).single(str(path))
    assert read.names == ("B2", "H12") and read.times[-1] == 24 and read.units["t"] == "h"


def test_fields_are_chosen_by_their_name_in_the_file(tmp_path: Path) -> None:
    rows = [f"{t},{np.sin(t):.3f},{t % 2},{np.cos(t):.3f},ok" for t in TIMES]
    text = "\n".join(["Zeit (s),T 1 (K),P (W),T 2 (K),state", *rows, ""])
    found = written(tmp_path, text, "fields=T 1", "inputs=P (W)")
    assert found == {"columns": {"time": "Zeit", "T_1": "T 1"}, "fields": ["T_1"]}
    for words, says in (
        (["fields=P (W)", "inputs=P (W)"], "'P' is not a field"),
        (["fields=T 3"], "no column 'T 3'"),
        (["fields=T 1", "ignore=T 1"], "'T_1' is needed"),
    ):
        (tmp_path / "mine.yaml").unlink(missing_ok=True)
        with pytest.raises(InputError, match=says):
            written(tmp_path, text, *words)


def test_a_serial_log_is_read_with_its_messages(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{500 * i};{20 + np.sin(i):.2f};{'ON' if i > 20 else 'OFF'};" for i in range(40)]
    head = ["Booting...", "SD card OK; starting log", "", "millis;T_in;heater;"]
    text = "\r\n".join([*head, *rows[:25], "read error", *rows[25:], "[Peaks]", "no;at", "1;2", ""])
    assert written(tmp_path, text) == {"columns": None, "fields": ["T_in"]}
    said = capsys.readouterr().out
    assert "left out: 4 lines, the first is line 30 (not a row of the table)" in said
    assert "left out: heater (text)" in said and "such as 1 for on and 0 for off" in said
    (tmp_path / "mine.yaml").unlink()
    with pytest.raises(InputError, match="'OFF' is not a number") as told:
        written(tmp_path, text, "inputs=heater")
    assert "such as 1 for ON and 0 for OFF" in str(told.value.hint)


def test_a_column_that_begins_after_the_part_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{t},{np.sin(t):.3f},{'' if t < 6 else np.cos(t)}" for t in TIMES]
    found = written(tmp_path, "\n".join(["time,x,late", *rows, ""]), "end=5")
    assert found["fields"] == ["x"]
    assert "left out: late (no values in the part that is used)" in capsys.readouterr().out


@pytest.mark.parametrize("names", [("sensor", "value"), ("dvid", "dv")])
def test_numbers_name_the_sensors_if_both_headers_say_so(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    rows = [
        f"{run},{t},{s},{run + t + s if t else '.'}"
        for run in (7, 8, 9)
        for s in (1, 2)
        for t in TIMES
    ]
    found = written(tmp_path, "\n".join([f"id,time,{','.join(names)}", *rows, ""]))
    own = {"episode": "id", "sensor": names[0], "value": names[1]}
    assert found["columns"] == {**own, "u_1": "1", "u_2": "2"}
    assert found["fields"] == ["u_1", "u_2"]


def test_a_reading_that_is_repeated_is_told_with_its_episode(tmp_path: Path) -> None:
    rows = [f"{run},{t},{s},{t}" for run in (7, 8) for s in "ab" for t in TIMES]
    path = tmp_path / "r.csv"
    path.write_text("\n".join(["subject,time,channel,value", *rows, rows[-1], ""]))
    with pytest.raises(InputError, match="'b' has a second reading at this time of episode '8'"):
        command.main([f"path={path}", f"output={tmp_path / 'mine.yaml'}"])


def test_elapsed_times_come_before_a_count_of_the_rows(tmp_path: Path) -> None:
    rows = [f"{i},{13 + i // 8},{np.cos(t)},{t}" for i, t in enumerate(TIMES)]
    path, output = tmp_path / "r.csv", tmp_path / "mine.yaml"
    path.write_text("\n".join(["id,hour,u,elapsed", *rows, ""]))
    assert command.main([f"path={path}", f"output={output}"]) == 0
    config = load_config([f"conf={output}"], entry="train")
    [episode] = read_recorded(config, System(config.system, config.where)).episodes
    np.testing.assert_array_equal(episode.recording.times, TIMES)


def test_a_row_for_each_time_and_place_is_a_field_in_space(tmp_path: Path) -> None:
    rows = [f"{t},{x},{np.cos(x + t)}" for t in TIMES for x in (0.2, 1.0, 1.8)]
    path, output = tmp_path / "r.csv", tmp_path / "mine.yaml"
    path.write_text("\n".join(["t,depth below surface (m),temperature,", *rows, ""]))
    assert command.main([f"path={path}", f"output={output}"]) == 0
    config = load_config([f"conf={output}"], entry="train")
    assert [*config.system.axes] == ["depth_below_surface"]
    assert [*config.system.fields] == ["temperature"]
    system = System(config.system, config.where)
    [episode] = read_recorded(config, system).episodes
    assert [sensor.position for sensor in episode.recording.sensors] == [(0.2,), (1.0,), (1.8,)]


def test_fields_called_x_and_y_are_no_places(tmp_path: Path) -> None:
    rows = [f"{t},{np.cos(t)},{np.sin(t)}" for _ in range(2) for t in TIMES]
    found = written(tmp_path, "\n".join(["t,x,y", *rows, ""]))
    assert found["fields"] == ["x", "y"]


@pytest.mark.parametrize("other", [0.0, 1.0])
def test_a_repeated_header_is_a_field_unless_it_is_a_copy(tmp_path: Path, other: float) -> None:
    rows = [f"{t},{np.sin(t)},{np.sin(t) + other}" for t in TIMES]
    found = written(tmp_path, "\n".join(["time,u,u", *rows, ""]))
    assert found["fields"] == (["u", "u_2"] if other else ["u"])
    assert found["columns"] == ({"u_2": "u (2)"} if other else None)
    (tmp_path / "mine.yaml").unlink()
    left = written(tmp_path, "\n".join(["time,u,u", *rows, ""]), "ignore=u (2)")
    assert left["fields"] == ["u"]


def test_the_index_of_a_data_frame_is_no_field(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{i},{t},{np.sin(t)}" for i, t in enumerate(TIMES)]
    assert written(tmp_path, "\n".join([",time,u", *rows, ""]))["fields"] == ["u"]
    assert "left out: column_1 (constant, or a count of the rows)" in capsys.readouterr().out
