"""A stranger's CSV becomes a configuration that loads and says what is left to do."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from dashred import train
from dashred.config import Config, load_config
from dashred.config.checks.placeholders import refuse_unfinished_lines
from dashred.core.errors import InputError
from dashred.physics.system import System
from dashred.pipeline.init import command
from dashred.pipeline.input.read_recorded import read_recorded
from tests.pipeline.init.strangers import bar_csv, swing_csv


def written(tmp_path: Path, *words: str) -> tuple[Config, str]:
    output = tmp_path / "mine.yaml"
    assert command.main([*words, f"output={output}"]) == 0
    return load_config([f"conf={output}"], entry="train"), output.read_text(encoding="utf-8")


def test_what_is_still_to_do_is_not_analysed(tmp_path: Path) -> None:
    written(tmp_path, f"path={swing_csv(tmp_path)}")
    with pytest.raises(InputError, match="this line is still to do") as told:
        train.main([f"conf={tmp_path / 'mine.yaml'}", f"output={tmp_path / 'out'}"])
    assert "mine.yaml:" in str(told.value)
    assert not (tmp_path / "out").exists()
    given = load_config(
        [f"conf={tmp_path / 'mine.yaml'}", "system.equations.speed=-angle"], entry="train"
    )
    refuse_unfinished_lines(given)


def test_columns_of_an_ode_are_its_fields_and_one_is_the_other_s_rate(tmp_path: Path) -> None:
    path = swing_csv(tmp_path)
    config, text = written(tmp_path, f"path={path}")
    assert config.recording.path == str(path)
    assert list(config.system.fields) == ["angle", "speed"]
    assert config.system.equations == {"angle": "speed", "speed": "0"}
    assert config.system.start["angle"] == pytest.approx(1, abs=0.02)
    assert text.count("TO DO:") == 1


def test_an_acceleration_is_a_let(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        (t, 2 * t + t * t - 0.1 * t**3, 2 + 2 * t - 0.3 * t * t, 2 - 0.6 * t)
        for t in (0.02 * i for i in range(100))
    ]
    lines = [",".join(f"{value:.5f}" for value in row) for row in rows]
    (tmp_path / "cart.csv").write_text("\n".join(["time,x,v,a", *lines, ""]))
    config, text = written(tmp_path, f"path={tmp_path / 'cart.csv'}")
    assert list(config.system.fields) == ["x", "v"] and config.system.let == {"a": "0"}
    assert config.system.equations == {"x": "v", "v": "a"}
    assert list(config.system.start) == list(config.system.spread) == ["x", "v"]
    assert text.count("TO DO:") == 1 and "for example -k*v" in text
    assert "a: the rate of a rate is a let" in capsys.readouterr().out


def test_a_kilohertz_recording_of_a_slow_swing_is_thinned(tmp_path: Path) -> None:
    """A sixteenth of the period, 0.0625, in round numbers."""
    config, _ = written(tmp_path, f"path={swing_csv(tmp_path)}")
    assert config.recording.every == pytest.approx(0.05)
    assert config.system.integrator.dt is None


def test_a_start_is_as_wide_as_episodes_begin_apart(tmp_path: Path) -> None:
    times = [0.1 * i for i in range(60)]
    rows = [
        f"{name},{t:.3f},{x * math.cos(t):.4f},{-x * math.sin(t):.4f}\n"
        for name, x in (("first", 1.0), ("second", -3.0))
        for t in times
    ]
    (tmp_path / "two.csv").write_text("episode,time,x,v\n" + "".join(rows))
    config, text = written(tmp_path, f"path={tmp_path / 'two.csv'}")
    assert "# mean of the episodes' first values" in text
    assert config.system.start["x"] == pytest.approx(-1)
    assert config.system.spread["x"] == pytest.approx(2)


def test_marks_of_missing_values_do_not_widen_the_start(tmp_path: Path) -> None:
    def guessed(*gone: int) -> float:
        swing = [(i, 0.5 * math.cos(0.1 * i)) for i in range(200)]
        rows = [f"{0.1 * i:.1f},{-999 if i in gone else x:.4f}\n" for i, x in swing]
        (tmp_path / "swing.csv").write_text("time,x\n" + "".join(rows))
        config, _ = written(tmp_path, f"path={tmp_path / 'swing.csv'}")
        (tmp_path / "mine.yaml").unlink()
        return float(config.system.spread["x"])

    assert guessed(40, 41, 90) == pytest.approx(guessed(), rel=0.05)


def test_two_clocks_in_one_table_are_kept(tmp_path: Path) -> None:
    rows = [f"{0.1 * i:.3f},{i},\n{0.1 * i + 0.003:.3f},,{-i}\n" for i in range(100)]
    (tmp_path / "two.csv").write_text("time,u,v\n" + "".join(rows))
    config, _ = written(tmp_path, f"path={tmp_path / 'two.csv'}")
    assert config.recording.every is None


def test_two_clocks_of_sensors_in_space_get_the_step_of_either(tmp_path: Path) -> None:
    rows = [f"{0.1 * i:.3f},{i},\n{0.1 * i + 0.003:.3f},,{-i}\n" for i in range(100)]
    (tmp_path / "two.csv").write_text("time,a,b\n" + "".join(rows))
    (tmp_path / "places.csv").write_text("name,field,x\na,u,0.1\nb,u,0.7\n")
    words = f"path={tmp_path / 'two.csv'}", f"sensors={tmp_path / 'places.csv'}"
    config, text = written(tmp_path, *words)
    assert config.recording.every == pytest.approx(0.1)
    assert "uneven steps, or several clocks" in text


def test_a_table_of_sensors_makes_a_field_in_space(tmp_path: Path) -> None:
    path, table = bar_csv(tmp_path)
    config, text = written(tmp_path, f"path={path}", f"sensors={table}")
    assert config.recording.sensors == str(table)
    assert list(config.system.fields) == ["T"]
    assert config.system.axes["x"].length == pytest.approx(9.6)
    assert config.system.equations == {"T": "0"}
    assert text.count("TO DO:") == 2


def test_units_in_headers_are_the_configuration_s(tmp_path: Path) -> None:
    path = swing_csv(tmp_path, "time [s],angle [rad],speed [rad/s]")
    config, _ = written(tmp_path, f"path={path}")
    assert config.system.units == {"t": "s", "angle": "rad", "speed": "rad/s"}


def test_a_file_that_is_there_is_left_as_it_is(tmp_path: Path) -> None:
    output = tmp_path / "mine.yaml"
    output.write_text("mine")
    with pytest.raises(InputError, match="already"):
        command.main([f"path={swing_csv(tmp_path)}", f"output={output}"])
    assert output.read_text() == "mine"


def test_two_columns_of_times_are_refused(tmp_path: Path) -> None:
    path = swing_csv(tmp_path, "Time,angle,Date")
    with pytest.raises(InputError, match="which column has the times"):
        command.main([f"path={path}", f"output={tmp_path / 'mine.yaml'}"])
    assert not (tmp_path / "mine.yaml").exists()


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("time,lambda,speed", {"lambda_0": "lambda"}),
        ("Time (s),angle (rad),wind speed", {"wind_speed": "wind speed"}),
        ("time,angle,t", {"t_0": "t"}),
        ("x-axis,angle,1", {"time": "x-axis", "u_1": "1"}),
        ("time,Größe,a.b", {"Groe": "Größe", "a_b": "a.b"}),
    ],
)
def test_headers_that_no_equation_can_hold_get_another_name(
    tmp_path: Path, header: str, columns: dict[str, str]
) -> None:
    config, _ = written(tmp_path, f"path={swing_csv(tmp_path, header)}")
    assert config.recording.columns == columns
    assert set(columns) - {"time"} <= set(config.system.fields)


def test_a_table_without_names_gets_some(tmp_path: Path) -> None:
    path = Path(swing_csv(tmp_path))
    path.write_text(path.read_text().split("\n", 1)[1])
    config, _ = written(tmp_path, f"path={path}")
    assert config.recording.columns == ["time", "u1", "u2"]
    assert list(config.system.fields) == ["u1", "u2"]


def test_inputs_counters_and_constants_are_no_fields(tmp_path: Path) -> None:
    rows = [
        f"{i + 1},{0.1 * i:.1f},{math.sin(0.1 * i):.3f},{i // 20},{i % 7},3,{i + 182}"
        for i in range(100)
    ]
    path = tmp_path / "driven.csv"
    path.write_text("\n".join(["rownames,time,u,Heater 1 (%),q,Dose,day", *rows, ""]))
    config, _ = written(tmp_path, f"path={path}", "inputs=Heater 1 (%),q")
    assert list(config.system.fields) == ["u"]
    assert config.system.inputs["Heater_1"].hold
    assert not config.system.inputs["q"].hold
    (tmp_path / "mine.yaml").unlink()
    with pytest.raises(InputError, match="no column 'Heater'"):
        written(tmp_path, f"path={path}", "inputs=Heater")


def test_a_constant_of_each_episode_may_be_an_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [
        f"{name},{dose},7,{0.1 * i:.1f},{dose * math.exp(-0.1 * i):.4f}"
        for name, dose in (("a", 2), ("b", 3))
        for i in range(30)
    ]
    path = tmp_path / "subjects.csv"
    path.write_text("\n".join(["episode,Dose,room,time,u", *rows, ""]))
    written(tmp_path, f"path={path}")
    said = capsys.readouterr().out
    assert "left out: room (constant" in said
    assert "left out: Dose (one value in each episode)" in said
    assert "inputs=Dose" in said


def test_columns_are_left_out_by_their_name_in_the_file(tmp_path: Path) -> None:
    rows = [f"{0.1 * i:.1f},{math.sin(0.1 * i):.3f},{i**0.5:.3f},{i % 7}" for i in range(100)]
    path = tmp_path / "more.csv"
    path.write_text("\n".join(["time,u,Set point (degC),q", *rows, ""]))
    config, _ = written(tmp_path, f"path={path}", "inputs=q", "ignore=Set point (degC)")
    assert list(config.system.fields) == ["u"]
    assert config.recording.ignore == ["Set_point"]
    system = System(config.system, config.where)
    assert read_recorded(config, system).single(str(path)).names == ("u",)
    for word, says in (
        ("t", "no column 't'"),
        ("time", "'time' is needed"),
        ("q", "'q' is needed"),
    ):
        (tmp_path / "mine.yaml").unlink(missing_ok=True)
        with pytest.raises(InputError, match=says):
            written(tmp_path, f"path={path}", "inputs=q", f"ignore={word}")


def test_dates_get_a_unit_of_the_size_of_their_step(tmp_path: Path) -> None:
    rows = [f"2024-05-{1 + i // 24:02d} {i % 24:02d}:00,{math.sin(0.3 * i):.3f}" for i in range(90)]
    (tmp_path / "hours.csv").write_text("\n".join(["date,T", *rows, ""]))
    config, _ = written(tmp_path, f"path={tmp_path / 'hours.csv'}")
    assert config.system.units == {"t": "h"}


def test_a_table_without_times_asks_for_its_step(tmp_path: Path) -> None:
    rows = "".join(f"{math.cos(0.1 * i):.3f},{math.sin(0.1 * i):.3f}\n" for i in range(60))
    (tmp_path / "steps.csv").write_text("u,V1\n" + rows)
    config, text = written(tmp_path, f"path={tmp_path / 'steps.csv'}")
    assert config.recording.every == 1.0
    assert "TO DO: the file has no times" in text


def test_a_count_of_the_rows_need_not_be_the_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{i},{math.cos(0.1 * i):.4f}" for i in range(60)]
    path = tmp_path / "scope.csv"
    path.write_text("\n".join(["Sequence,Volt", *rows, ""]))
    written(tmp_path, f"path={path}")
    assert "times: Sequence, which may only count the rows" in capsys.readouterr().out
    (tmp_path / "mine.yaml").unlink()
    config, text = written(tmp_path, f"path={path}", "ignore=Sequence")
    assert list(config.system.fields) == ["Volt"] and text.count("TO DO:") == 2
    system = System(config.system, config.where)
    config.recording.every = 0.5
    assert read_recorded(config, system).single(str(path)).times[2] == 1.0


def test_runs_below_each_other_are_episodes(tmp_path: Path) -> None:
    rows = [f"{run};{0.1 * i:.1f};{math.cos(0.1 * i):.3f}" for run in "ab" for i in range(40)]
    (tmp_path / "runs.csv").write_text("\n".join(["Subject;Time (min);x", *rows, ""]))
    config, _ = written(tmp_path, f"path={tmp_path / 'runs.csv'}")
    assert config.recording.columns == {"episode": "Subject"}
    assert config.system.units == {"t": "min"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "path= is missing"),
        (["path=a.nc"], "not a table of text"),
        (["pth=a.csv"], "path"),
        (["path=a.csv", "output=a.txt"], ".yaml"),
        (["path=gone.csv"], "no such file"),
        (["path=a.csv", "output=gone/a.yaml"], "no such folder"),
    ],
)
def test_wrong_words_say_what_to_do(words: list[str], says: str) -> None:
    with pytest.raises(InputError) as told:
        command.main(words)
    assert says in str(told.value)


@pytest.mark.parametrize(
    ("fields", "more", "says"),
    [
        ("length", "", "the field 'length' has the name of a key of system.spread"),
        ("x", "", "the field 'x' has the name of a coordinate"),
        ("u", "north wall", "table.csv:1, column 'note': the column 'note' is not a coordinate"),
    ],
)
def test_a_table_that_no_configuration_can_hold_is_refused(
    tmp_path: Path, fields: str, more: str, says: str
) -> None:
    rows = [f"{0.1 * i:.1f},{i},{-i}\n" for i in range(40)]
    (tmp_path / "my.csv").write_text("time,a,b\n" + "".join(rows))
    note = (",note", f",{more}") if more else ("", "")
    table = f"name,field,x{note[0]}\na,{fields},1{note[1]}\nb,{fields},2{note[1]}\n"
    (tmp_path / "table.csv").write_text(table)
    places = [f"path={tmp_path / 'my.csv'}", f"sensors={tmp_path / 'table.csv'}"]
    with pytest.raises(InputError) as told:
        command.main([*places, f"output={tmp_path / 'mine.yaml'}"])
    assert says in str(told.value)
    assert not (tmp_path / "mine.yaml").exists()


def test_hundreds_of_columns_are_no_ode(tmp_path: Path) -> None:
    names = ",".join(f"s{i}" for i in range(300))
    rows = [f"{t}," + ",".join(["1.0"] * 300) + "\n" for t in range(30)]
    (tmp_path / "wide.csv").write_text(f"time,{names}\n" + "".join(rows))
    with pytest.raises(InputError, match="300 columns besides time") as told:
        command.main([f"path={tmp_path / 'wide.csv'}", f"output={tmp_path / 'mine.yaml'}"])
    assert "sensors=TABLE.csv" in str(told.value)


def test_names_that_yaml_reads_as_something_else_are_quoted(tmp_path: Path) -> None:
    config, _ = written(tmp_path, f"path={swing_csv(tmp_path, 'time,null,true')}")
    assert list(config.system.fields) == ["null", "true"]


def test_a_part_of_the_recording_is_guessed_from_and_written(tmp_path: Path) -> None:
    config, _ = written(tmp_path, f"path={swing_csv(tmp_path)}", "begin=2.5", "end=7")
    assert (config.recording.begin, config.recording.end) == (2.5, 7)
    assert config.system.start["angle"] == pytest.approx(-1, abs=0.02)


def test_the_waves_of_the_start_follow_the_length_of_the_axis(tmp_path: Path) -> None:
    path, table = bar_csv(tmp_path)
    _, text = written(tmp_path, f"path={path}", f"sensors={table}")
    assert "cos(2*pi*x/x_length)" in text
    words = [f"conf={tmp_path / 'mine.yaml'}", "system.axes.x.length=12"]
    start = load_config(words, entry="train").system.start["T"]
    assert "cos(2*pi*x/12.0)" in start
    assert "x_length" not in start
