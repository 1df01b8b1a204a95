"""Wrong input: exit code 2, one message that names place and remedy, and nothing left behind."""

from __future__ import annotations

import re
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.evaluation.twins import record_command

CHECKOUT = Path(__file__).resolve().parents[2]
SENSORS = "name,field,x,std\n" + "".join(f"p{i},u,{0.5 + i},0.02\n" for i in range(6))


def csv_text(columns: int = 6, rows: int = 41) -> str:
    lines = [",".join(["time", *(f"p{i}" for i in range(columns))])]
    for row in range(rows):
        t = 0.1 * row
        cells = [f"{1 + 0.5 * np.sin(0.5 + i - t):.4f}" for i in range(columns)]
        lines.append(",".join([f"{t:.1f}", *cells]))
    return "\n".join(lines) + "\n"


def cell(row: int, column: int, value: str) -> str:
    """Return the recording with one cell changed; row 0 is the header."""
    lines = [line.split(",") for line in csv_text().splitlines()]
    lines[row][column] = value
    return "\n".join(",".join(line) for line in lines) + "\n"


def without_values(column: int) -> str:
    lines = [line.split(",") for line in csv_text().splitlines()]
    for line in lines[1:]:
        line[column] = ""
    return "\n".join(",".join(line) for line in lines) + "\n"


def assert_refused(ended, *says: str) -> None:
    assert ended.code == 2, ended.err
    assert ended.err.startswith("error: ")
    assert "Traceback" not in ended.err + ended.out
    for text in says:
        assert text in ended.err
    assert not ended.output.exists() or not list(ended.output.iterdir())
    assert runs_left(ended.root) == 0
    assert not list((ended.root / "artifacts").glob("*"))


def runs_left(root: Path) -> int:
    store = root / "mlflow.db"
    if not store.exists():
        return 0
    with sqlite3.connect(store) as database:
        [[count]] = database.execute("select count(*) from runs where lifecycle_stage = 'active'")
    database.close()
    return int(count)


@pytest.fixture
def own(tmp_path: Path):
    """``own(text)``: the words that analyse a CSV recording with such a text."""

    def words(text: str | None, sensors: str = SENSORS) -> list[str]:
        (tmp_path / "sensors.csv").write_text(sensors)
        if text is not None:
            (tmp_path / "mine.csv").write_text(text)
        return [
            f"recording.path={tmp_path / 'mine.csv'}",
            f"recording.sensors={tmp_path / 'sensors.csv'}",
        ]

    return words


@pytest.mark.slow
def test_the_recording_that_the_others_spoil_is_good(quick, train, own) -> None:
    ended = train(f"conf={quick}", *own(csv_text()))
    assert ended.code == 0, ended.err
    assert (ended.output / "findings.json").is_file()
    assert runs_left(ended.root) == 5


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (cell(0, 3, "q2"), ("mine.csv", "sensor 'p2' has no column", "one of: time, p0, p1")),
        (cell(7, 3, "1,5".replace(",", ";")), ("mine.csv:8, column 'p2'", "'1;5' is not a number")),
        (cell(4, 1, "high"), ("mine.csv:5, column 'p0'", "'high' is not a number", "leave")),
        (cell(0, 0, "depth"), ("mine.csv", "no column 'time'", "depth, p0")),
        (cell(9, 0, "0.3"), ("mine.csv:10, column 'time'", "time decreases", "must increase")),
        (cell(9, 0, "0.7"), ("mine.csv:10, column 'time'", "time is repeated")),
        (cell(9, 0, ""), ("mine.csv:10, column 'time'", "time is missing")),
        (without_values(5), ("mine.csv", "'p4' has no values", "recording.ignore")),
        (csv_text(rows=7), ("mine.csv", "7 samples are too few", "at least 8")),
        ("", ("mine.csv", "the file is empty")),
        (None, ("mine.csv", "no such file")),
    ],
    ids=[
        "unknown-sensor",
        "decimal-semicolon",
        "word",
        "no-time",
        "time-back",
        "time-twice",
        "time-missing",
        "all-nan",
        "short",
        "empty",
        "missing",
    ],
)
def test_wrong_recordings(quick, train, own, text, says) -> None:
    assert_refused(train(f"conf={quick}", *own(text)), *says)


def test_too_few_sensors_to_hold_any_out(quick, train, own) -> None:
    split = ["splits.sensors.validate=[p0, p1]", "splits.sensors.test=[p2, p3, p4, p5]"]
    ended = train(f"conf={quick}", *own(csv_text()), *split)
    assert_refused(ended, "all 6 sensors are held out", "splits.sensors.test")


def test_a_recording_needs_its_table_of_sensors(quick, train, own) -> None:
    [path, _] = own(csv_text())
    assert_refused(train(f"conf={quick}", path), "mine.csv", "recording.sensors=PATH")


def test_a_sensor_that_reads_what_the_system_does_not_have(quick, train, own) -> None:
    ended = train(f"conf={quick}", *own(csv_text(), SENSORS.replace("p3,u", "p3,w")))
    assert_refused(ended, "sensors.csv:5", "'w'", "u")


@pytest.mark.parametrize(
    ("equation", "says"),
    [
        ("-u*d(u, x) + nu*lap(u", ("^",)),
        ("-u*d(u, x) +* nu*lap(u)", ("^",)),
        ("-u*d(u, x) + nuu*lap(u)", ("'nuu'", "mean nu?")),
        ("-u*d(u, x) + nu*lapl(u)", ("'lapl'", "mean lap?")),
        ("-u^2", ("**",)),
        ("__import__('os').system('touch hacked')", ()),
        ("u.real", ()),
        ("(lambda: u)()", ("lambda",)),
        ("[u for u in x]", ()),
        ("u if u > 0 else 0", ()),
        ("f'{u}'", ()),
        ("lam*u", ("'lam'",)),
    ],
)
def test_wrong_equations(quick, train, own, tmp_path, equation, says) -> None:
    """Pointed at, in the file that holds them; code is an expression like any other wrong one."""
    path = tmp_path / "mine.yaml"
    text = quick.read_text()
    wrong = text.replace('"-d(u**2/2, x) + nu*lap(u)"', f'"{equation}"')
    assert wrong != text
    path.write_text(wrong)
    ended = train(f"conf={path}", *own(csv_text()))
    assert_refused(ended, f"{path}:6", *says)
    assert not Path("hacked").exists()


def test_a_wrong_equation_is_refused_before_any_process_begins(quick, train, processes) -> None:
    ended = train(f"conf={quick}", "system.equations.u=-d(u**2/2, x) + nuu*lap(u)")
    assert_refused(ended, "command line", "'nuu'", "mean nu?")
    assert not processes


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["conf=rdee"], ("command line", "unknown conf 'rdee'", "conf=rde")),
        (["conf=nowhere.yaml"], ("nowhere.yaml", "no such file", "bundled: ")),
        (["conf=rde", "shred.lag=3"], ("command line", "shred.lags")),
        (["conf=rde", "shred.lags=many"], ("command line", "shred.lags", "'many'")),
        (["conf=rde", "seed=1.5"], ("command line", "seed")),
        (["conf=rde", "system.parameters.nv=1"], ("command line", "nv", "nu")),
        (["conf=rde", "recording.twin=../rde"], ("command line", "not the name of a twin")),
        (["conf=rde", "device=gpu"], ("command line", "unknown device 'gpu'", "cuda")),
        (["rde"], ("command line", "expected key=value")),
        ([], ("command line", "conf= is missing", "rde")),
    ],
)
def test_wrong_words(train, words, says) -> None:
    assert_refused(train(*words), *says)


def test_an_unknown_twin(quick, train) -> None:
    assert_refused(train(f"conf={quick}", "recording.twin=z"), "no twin 'z'", "a, b, null")


def test_a_system_without_twins(quick, train, tmp_path) -> None:
    path = tmp_path / "lonely.yaml"
    path.write_text(quick.read_text())
    ended = train(f"conf={path}")
    assert_refused(ended, "twins/lonely.yaml", "lonely has no twins", "recording.path=FILE")


@pytest.mark.parametrize(
    ("twin", "says"),
    [
        ("terms: [{equation: v, term: u, coefficient: 1}]", "no equation 'v'"),
        ("terms: [{equation: u, term: w, coefficient: 1}]", "'w'"),
        ("terms: [{equation: u, term: u, coefficient: much}]", "much"),
        ("terms: [u]", "an equation, a term and a coefficient"),
        ("terms: u", "must be a list"),
        ("start: own", "must have terms"),
        ("{terms: [], start: elsewhere}", "simulator or own"),
        ("{terms: [], stated: often}", "often"),
    ],
)
def test_wrong_twins(quick, tmp_path, twin, says) -> None:
    (tmp_path / "twins").mkdir()
    (tmp_path / "mine.yaml").write_text(quick.read_text())
    (tmp_path / "twins" / "mine.yaml").write_text(f"a:\n  {twin}\n")
    with pytest.raises(InputError, match=re.escape(says)):
        record_command.main([f"conf={tmp_path / 'mine.yaml'}", f"output={tmp_path / 'out'}"])
    assert not (tmp_path / "out").exists()


def test_a_truth_that_blows_up(quick, train) -> None:
    ended = train(f"conf={quick}", "system.equations.u=u**2 + nu*lap(u)")
    assert_refused(ended, "blows up: u is not finite at t = ")


def test_an_ensemble_that_blows_up_where_the_simulator_does_not(quick, train, own) -> None:
    calm = ["system.equations.u=u**2 + nu*lap(u)", "system.start.u=-2 + 0.1*sin(x)"]
    ended = train(f"conf={quick}", *own(csv_text()), *calm, "system.spread.u=200")
    assert_refused(ended, "of 24 simulations stay within bounds", "make system.spread")


def test_a_library_that_only_the_analysis_reads_leaves_no_run_of_a_twin(
    quick, train, processes
) -> None:
    """The recorder has done its part then, and the run is open: all of it is taken back."""
    ended = train(f"conf={quick}", "library.u=[u, 2*u]")
    assert_refused(ended, "'u' and '2*u' are the same term")
    assert [words[0] for words in processes] == [
        "dashred.evaluation.twins.record_command",
        "dashred.pipeline.analyse",
    ]


def test_cuda_on_a_machine_without(quick, train, own, monkeypatch) -> None:
    monkeypatch.setattr("torch.cuda.device_count", lambda: 0)
    ended = train(f"conf={quick}", *own(csv_text()), "device=cuda")
    assert_refused(ended, "command line", "0 CUDA devices", "device=cpu")


def test_an_output_that_is_a_file(quick, train, own, tmp_path) -> None:
    (tmp_path / "output").write_text("mine")
    for words in ([f"conf={quick}"], [f"conf={quick}", *own(csv_text())]):
        ended = train(*words)
        assert ended.code == 2
        assert str(ended.output) in ended.err and "output=DIR" in ended.err
        assert (tmp_path / "output").read_text() == "mine"
        assert runs_left(ended.root) == 0


def command(*words: str) -> tuple[subprocess.CompletedProcess[str], float]:
    began = time.perf_counter()
    ended = subprocess.run(
        [sys.executable, "-m", "dashred.train", *words],
        cwd=CHECKOUT,
        capture_output=True,
        text=True,
    )
    return ended, time.perf_counter() - began


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["--help"], 0, "usage: dashred train conf=SYSTEM"),
        (["resume=abc", "--help"], 0, "resume=RUN_ID"),
        (["conf=rde", "shred.lag=3"], 2, "shred.lags"),
        (["conf=rdee"], 2, "conf=rde"),
        (["conf=rde", "system.equations.u=foo(u)"], 2, "unknown function 'foo'"),
        (["conf=rde", "system.start.u=sin(y)"], 2, "'y'"),
        (["conf=rde", "library={u: [u*w]}"], 2, "'w'"),
        (["conf=pendulum", "system.integrator.method=etdrk4"], 2, "does not fit this system"),
        (["conf=rde", "system.parameters.nv=1"], 2, "nv"),
    ],
)
def test_the_command_answers_within_two_seconds(words, code, says) -> None:
    seconds = []
    # The best of several: other work on this machine is not what is measured.
    for _ in range(5):
        ended, took = command(*words)
        assert ended.returncode == code, ended.stderr
        assert says in (ended.stderr if code else ended.stdout)
        assert "Traceback" not in ended.stderr
        seconds.append(took)
        if took < 2:
            break
    assert min(seconds) < 2


def test_a_real_process_refuses_a_recording_without_a_trace(quick, own, tmp_path) -> None:
    root = f"tracking.root={tmp_path / 'mlruns'}"
    words = [f"conf={quick}", *own(cell(4, 1, "high")), f"output={tmp_path / 'out'}", root]
    ended, _ = command(*words)
    assert ended.returncode == 2
    assert ended.stdout == ""
    first, second = ended.stderr.splitlines()
    assert first == f"error: {tmp_path / 'mine.csv'}:5, column 'p0': 'high' is not a number"
    assert second.startswith("  write numbers as")
    assert {path.name for path in tmp_path.iterdir()} == {"mine.csv", "sensors.csv"}
