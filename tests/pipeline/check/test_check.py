"""The check command on good and bad input, and without access to a twin's truth."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.pipeline.check import command
from dashred.pipeline.init import command as init
from tests.pipeline.init.strangers import bar_csv, swing_csv

SWING = """\
system:
  title: Swing
  fields: {x: place, v: speed}
  equations: {x: v, v: -x}
  start: {x: 1, v: 0}
  spread: {x: 0.1, v: 0.1}
  integrator: {method: rk4, dt: 0.05}
recording: {path: swing.csv}
threads: 1
"""


def swing(folder: Path, rows: list[str] | None = None, header: str = "time,x,v") -> Path:
    """Write a swing at 200 samples, 1 % noise, and its configuration."""
    rng = np.random.default_rng(0)
    t = 0.2 * np.arange(200)
    x = np.cos(t) + 0.01 * rng.standard_normal(200)
    v = -np.sin(t) + 0.01 * rng.standard_normal(200)
    lines = rows or [f"{a:.3f},{b:.6f},{c:.6f}" for a, b, c in zip(t, x, v, strict=True)]
    (folder / "swing.csv").write_text("\n".join([header, *lines]) + "\n")
    (folder / "swing.yaml").write_text(SWING)
    return folder / "swing.yaml"


def rows_of(folder: Path) -> list[str]:
    return (folder / "swing.csv").read_text().splitlines()[1:]


def said(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> str:
    """Return what a check prints, its lines joined."""
    assert command.main(list(words)) == code
    return re.sub(r"\s+", " ", capsys.readouterr().out)


def test_a_good_recording_gives_no_warnings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = said(capsys, f"conf={swing(tmp_path)}")
    assert found.endswith("No errors and no warnings. ")
    assert "200 samples of 2 sensors" in found
    assert "t > 31.8 is held out" in found
    assert "The simulation is resolved" in found
    assert "resolve 2 of 2 modes" in found
    assert "The first sample is consistent with the prior" in found


def cells_of(row: str) -> list[str]:
    return row.split(",")


def with_v(rows: list[str], written: Callable[[int, str], str]) -> list[str]:
    """Replace v, given its row number and its old text."""
    cells = map(cells_of, rows)
    return [f"{t},{x},{written(i, v)}" for i, (t, x, v) in enumerate(cells)]


def in_degrees(rows: list[str]) -> list[str]:
    cells = [[float(cell) for cell in row.split(",")] for row in rows]
    return [f"{t},{57.3 * x},{57.3 * v}" for t, x, v in cells]


SPOILT: dict[str, Callable[[list[str]], list[str]]] = {
    "1 gap longer than 10 steps; the longest, 6.2": lambda rows: rows[:80] + rows[110:],
    "values are missing from v": lambda rows: with_v(rows, lambda i, v: v if i // 30 != 2 else ""),
    "mostly repeated values: v": lambda rows: with_v(rows, lambda i, _: f"{i // 3}"),
    "v reads -999 2 times, first at t = 6": lambda rows: with_v(
        rows, lambda i, v: "-999" if i in (30, 77) else v
    ),
    "x and v have identical values": lambda rows: [
        f"{t},{x},{x}" for t, x, _ in map(cells_of, rows)
    ],
    "57 times as much as in the simulator": in_degrees,
    "The first sample is more than 4 standard deviations": lambda rows: rows[12:],
    "50 samples are few": lambda rows: rows[:50],
}


def test_a_start_that_does_not_fit_the_shorter_episode_gives_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = rows_of(swing(tmp_path).parent)
    other = [row.split(",") for row in rows[:150]]
    far = [f"far,{t},{-3 * float(x):.6f},{-3 * float(v):.6f}" for t, x, v in other]
    path = swing(tmp_path, [*(f"near,{row}" for row in rows), *far], "episode,time,x,v")
    found = said(capsys, f"conf={path}")
    assert "The first sample of episode 'far' is more than 4 standard deviations" in found
    assert "This is the longest of 2 episodes" in found
    assert "episode 'near' is" not in found


def test_every_episode_is_checked_and_the_held_out_one_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = rows_of(swing(tmp_path).parent)
    stuck = [f"second,{t},{x},0.5" for t, x, _ in map(cells_of, rows[:100])]
    third = [f"third,{row}" for row in rows[:80]]
    first = [f"first,{row}" for row in rows]
    path = swing(tmp_path, [*first, *stuck, *third], "episode,time,x,v")
    found = said(capsys, f"conf={path}")
    assert "Episode second: Sensors with mostly repeated values: v" in found
    assert "Held-out episode: third" in found
    assert "Episode third:" not in found


@pytest.mark.parametrize("says", SPOILT)
def test_a_defect_of_a_recording_gives_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], says: str
) -> None:
    swing(tmp_path)
    found = said(capsys, f"conf={swing(tmp_path, SPOILT[says](rows_of(tmp_path)))}")
    assert says in found
    assert re.search(r"warnings? \(\?\)", found)


def test_oversampling_gives_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    swing_csv(tmp_path, "time,x,v")
    (tmp_path / "swing.yaml").write_text(SWING)
    found = said(capsys, f"conf={tmp_path / 'swing.yaml'}", "system.equations.v=-39.5*x")
    assert "recording.every=0.05 loses little" in found


def test_marks_of_missing_values_in_an_input_give_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    swing(tmp_path)
    rows = [
        f"{row},{-999 if i in (30, 31, 77) else math.sin(i):.3f}"
        for i, row in enumerate(rows_of(tmp_path))
    ]
    path = swing(tmp_path, rows, "time,x,v,force")
    path.write_text(SWING.replace("  start:", "  inputs: {f: force}\n  start:"))
    found = said(capsys, f"conf={path}", "system.equations.v=-x+0.01*f")
    assert "The input force is -999 3 times, far from its other values" in found


def test_a_clock_that_leaves_out_the_fastest_response_gives_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [
        f"{t:.2f},{math.cos(t) + 0.5 * math.exp(-t / 0.1):.5f},{-math.sin(t):.5f}"
        for t in (0.02 * i for i in range(2000))
    ]
    path = swing(tmp_path, rows)
    found = said(capsys, f"conf={path}", "recording.every=0.4")
    assert "x changes faster near t = 0.11 than the analysis clock can show" in found
    assert "recording.every=0.04 keeps the change" in found
    assert "changes faster" not in said(capsys, f"conf={path}", "recording.every=0.04")


@pytest.mark.parametrize("std", ["", "0.01"])
def test_two_loggers_in_one_table_give_no_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], std: str
) -> None:
    """Every second cell is empty."""
    conf = swing(tmp_path)
    rng, t = np.random.default_rng(0), 0.02 * np.arange(2000)
    noise = 0.01 * rng.standard_normal((2, 2000))
    x, v = np.cos(t) + noise[0], -np.sin(t) + noise[1]
    rows = [
        f"{a:.2f},,{c}" if i % 2 else f"{a:.2f},{b},"
        for i, (a, b, c) in enumerate(zip(t.tolist(), x.tolist(), v.tolist(), strict=True))
    ]
    swing(tmp_path, rows)
    (tmp_path / "table.csv").write_text(f"name,field,std\nx,x,{std}\nv,v,{std}\n")
    found = said(capsys, f"conf={conf}", f"recording.sensors={tmp_path / 'table.csv'}")
    assert "The noise looks white" in found
    assert re.search(r"The noise is about 1\.[345]( to 1\.[345])? % of the", found)


def test_a_wrong_recording_is_refused(tmp_path: Path) -> None:
    swing(tmp_path)
    rows = rows_of(tmp_path)
    with pytest.raises(InputError, match="time is repeated"):
        command.main([f"conf={swing(tmp_path, [*rows[:50], *rows[49:]])}"])


def test_an_unobserved_field_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The speed is not measured; where it moves nothing that is, it cannot be told."""
    swing(tmp_path)
    rows = [row.rsplit(",", 1)[0] for row in rows_of(tmp_path)]
    conf = swing(tmp_path, rows, "time,x")
    assert "v (not measured directly) is observed:" in said(capsys, f"conf={conf}")
    words = ["system.equations.x=-0.1*x", "library={x: [x], v: [v]}"]
    alone = said(capsys, f"conf={conf}", *words)
    assert "v (not measured directly) is not observed: 100%" in alone


def test_too_long_a_step_is_not_resolved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = said(
        capsys, f"conf={swing(tmp_path)}", "system.integrator.dt=0.2", "system.equations.v=-60*x"
    )
    assert "The simulation is not resolved" in found
    assert "if half of the step is too long as well" in found
    assert "decrease system.integrator.dt" in found


def test_too_coarse_a_grid_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    conf = tmp_path / "wave.yaml"
    conf.write_text("""
system:
  title: a steep wave
  axes: {x: {length: 1, points: 16}}
  fields: {u: height}
  equations: {u: "-4*u*d(u, x) + 0.001*lap(u)"}
  start: {u: sin(2*pi*x)}
  spread: {u: 1%, length: 0.2}
  integrator: {dt: 0.01}
recording: {path: wave.csv, sensors: sensors.csv}
""")
    places = np.arange(8) / 8
    rows = [f"s{i},u,{x}" for i, x in enumerate(places)]
    (tmp_path / "sensors.csv").write_text("\n".join(["name,field,x", *rows]))
    waves = [[t, *np.sin(2 * np.pi * (places - 0.1 * t))] for t in np.arange(30) / 50]
    names = ",".join(["time", *(f"s{i}" for i in range(8))])
    np.savetxt(tmp_path / "wave.csv", waves, delimiter=",", header=names, comments="")
    found = said(capsys, f"conf={conf}", code=2)
    assert "x The simulation is not resolved" in found and "a run would find no law" in found
    assert "decrease system.integrator.dt, or increase the points of the axes" in found
    chosen = said(capsys, f"conf={conf}", "system.integrator.dt=null", code=2)
    assert "smooth; increase the points of the axes" in chosen


def test_a_simulation_that_blows_up_is_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run restarts it from the readings, so it is not refused."""
    found = said(capsys, f"conf={swing(tmp_path)}", "system.equations.v=-x + v**3")
    assert "The simulation blows up soon after that" in found
    assert "The simulation is resolved" in found


def test_a_chaotic_simulation_is_resolved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """At doubled resolution its trajectory is another one, but each segment is the same."""
    conf = swing(tmp_path)
    rng = np.random.default_rng(1)
    rows = [f"{0.2 * j:.3f},{a:.4f},{b:.4f},{c:.4f}" for j, (a, b, c) in
            enumerate(8 * rng.standard_normal((200, 3)))]  # fmt: skip
    (tmp_path / "swing.csv").write_text("\n".join(["time,x,v,z", *rows]) + "\n")
    lorenz = SWING.replace("{x: v, v: -x}", "{x: 10*(v - x), v: x*(28 - z) - v, z: x*v - 8*z/3}")
    lorenz = lorenz.replace("v: speed", "v: speed, z: third").replace("v: 0}", "v: 0, z: 20}")
    conf.write_text(lorenz.replace("v: 0.1}", "v: 0.1, z: 0.1}").replace("dt: 0.05", "dt: 0.01"))
    assert "The simulation is resolved" in said(capsys, f"conf={conf}")


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return what a check prints that ends with 2, its lines joined."""
    assert command.main(list(words)) == 2
    return re.sub(r"\s+", " ", capsys.readouterr().out)


def test_a_structure_that_does_not_match_the_equations_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    conf, j = f"conf={swing(tmp_path)}", "J: {x: {v: 1}, v: {x: -1}}"
    good = said(capsys, conf, f"system.structure={{H: x**2/2 + v**2/2, {j}}}")
    assert "The declared structure reproduces the equations" in good
    wrong = refused(capsys, conf, f"system.structure={{H: x**2 + v**2/2, {j}}}")
    assert "x system.structure" in wrong or "x command line" in wrong


def test_an_ensemble_that_cannot_be_drawn_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = refused(capsys, f"conf={swing(tmp_path)}", "system.spread.x=1000")
    assert "x 0 of 24 members of the training ensemble stay within bounds" in told


def test_missing_devices_folders_and_servers_are_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torch.cuda.device_count", lambda: 0)
    conf = f"conf={swing(tmp_path)}"
    with pytest.raises(InputError, match="0 CUDA devices, not 'cuda'"):
        command.main([conf, "device=cuda"])
    for key in ("output", "tracking.root"):
        with pytest.raises(InputError, match=r"cannot be created: .*swing\.csv is not a folder"):
            command.main([conf, f"{key}={tmp_path / 'swing.csv' / 'new'}"])
    with pytest.raises(InputError, match="no MLflow server responds"):
        command.main([conf, "tracking.root=http://127.0.0.1:9"])


def test_the_unit_of_time_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = said(capsys, f"conf={swing(tmp_path)}", "system.units={t: h}")
    assert "t from 0 to 39.8 h" in found


def test_a_check_creates_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    conf = swing(tmp_path)
    before = sorted(tmp_path.iterdir())
    said(capsys, f"conf={conf}", f"output={tmp_path / 'a' / 'b'}")
    assert sorted(tmp_path.iterdir()) == before


def test_a_field_far_from_zero_gives_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A temperature in kelvins, a pressure in pascals: all functions of it are straight lines."""
    (tmp_path / "room.csv").write_text(
        "time,T\n" + "".join(f"{t},{290 + 5 * np.exp(-t / 20):.3f}\n" for t in range(100))
    )
    room = SWING.replace("{x: place, v: speed}", "{T: temperature}").replace("x: 1, v: 0", "T: 295")
    room = room.replace("{x: v, v: -x}", "{T: 0.05*(290 - T)}").replace("x: 0.1, v: 0.1", "T: 1")
    (tmp_path / "room.yaml").write_text(room.replace("swing.csv", "room.csv"))
    found = said(capsys, f"conf={tmp_path / 'room.yaml'}")
    assert "T varies by 1.3 about 291.3: its powers and functions are nearly collinear" in found
    assert "exp(-T**2) of T is excluded: it vanishes here" in found
    own = said(capsys, f"conf={tmp_path / 'room.yaml'}", "library={T: [T, T**2]}")
    assert "nearly collinear" not in own


def test_collinear_terms_are_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A decay from 1 is never negative: its sign is the constant."""
    words = ["system.equations.x=-0.1*x", "library={x: [1, sign(x)], v: [v]}"]
    assert command.main([f"conf={swing(tmp_path)}", *words]) == 2
    found = capsys.readouterr().out
    assert "x the terms '1' and 'sign(x)' are proportional" in found
    assert "1 error (x)" in found


def test_a_first_configuration_lists_what_is_left_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "mine.yaml"
    init.main([f"path={swing_csv(tmp_path)}", f"output={output}"])
    marked = [i for i, s in enumerate(output.read_text().splitlines(), 1) if "# TO DO:" in s]
    found = said(capsys, f"conf={output}", code=2)
    assert len(marked) == 1
    assert f"! {output}:{marked[0]}: write what you know of d(speed)/dt" in found
    assert "1 left to do (!)" in found


def test_a_first_configuration_in_space_can_be_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, table = bar_csv(tmp_path)
    output = tmp_path / "bar.yaml"
    init.main([f"path={path}", f"sensors={table}", f"output={output}"])
    found = said(capsys, f"conf={output}", code=2)
    assert "2 left to do (!)" in found
    assert "All simulated readings are constant" in found
    filled = said(capsys, f"conf={output}", "system.equations.T=0.5*lap(T)", code=2)
    assert "8 samples" not in filled and "80 samples of 8 sensors" in filled
    assert "Test sensors:" in filled
    assert "where the periodic axis" not in filled
    ramp = said(
        capsys, f"conf={output}", "system.equations.T=0.5*lap(T)", "system.start.T=x", code=2
    )
    assert "The start of T jumps by 9.45 where the periodic axis x closes" in ramp


def test_a_twin_s_configuration_is_checked_without_its_truths(
    quick: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = tmp_path / "quick.yaml"
    alone.write_text(quick.read_text())
    found = said(capsys, f"conf={alone}", "recording.twin=there-is-none")
    assert "There is no recording yet" in found
    assert "of 6 sensors" in found
    assert "u is observed" in found


def test_readings_that_vary_give_no_such_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A simulator that lacks the losses of a room keeps it at 295 K, while it was read to cool."""
    (tmp_path / "room.csv").write_text(
        "time,T\n" + "".join(f"{t},{295 * np.exp(-t / 50):.3f}\n" for t in range(100))
    )
    room = SWING.replace("{x: place, v: speed}", "{T: temperature}").replace("x: 1, v: 0", "T: 295")
    room = room.replace("{x: v, v: -x}", "{T: -0.01}").replace("x: 0.1, v: 0.1", "T: 1")
    (tmp_path / "room.yaml").write_text(room.replace("swing.csv", "room.csv"))
    assert "nearly collinear" not in said(capsys, f"conf={tmp_path / 'room.yaml'}")
