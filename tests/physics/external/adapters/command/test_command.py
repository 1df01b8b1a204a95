"""Commands as programs: files in NetCDF and text, failures, and that nothing is left behind."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.core.threads import use_threads
from dashred.physics.external.adapters.command.command import CommandWords, open_command
from dashred.physics.external.adapters.command.layout import Layout
from dashred.physics.external.adapters.command.netcdf_files import InputWriter, read_output
from dashred.physics.external.state_batch import StateBatch
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.grids.grid import Axis, Grid

PLACE = "mine.yaml:9"
PYTHON = [sys.executable, "-S", "-E"]
# du/dt = -k u and dv/dt = 1, for one state as text.
TEXT = """\
import math, sys
source, target = sys.argv[1:]
first, *rows = [line.split() for line in open(source)]
t, dt, k = map(float, first)
rows = [list(map(float, row)) for row in rows]
result = [(u * math.exp(-k * dt), v + dt) for u, v in rows]
{fault}
with open(target, "w") as file:
    print("# u, v", file=file)
    for u, v in result:
        print(repr(u), repr(v), sep=", ", file=file)
"""
TEMPLATE = """\
{{ t }} {{ dt }} {{ k }}
{% for i in range(x|length) %}
{{ u[i] }} {{ v[i] }}
{% endfor %}
"""
NETCDF = """\
import sys
import h5netcdf
import numpy as np
source, target = sys.argv[1:]
with h5netcdf.File(source) as given:
    u, dt, f = (given[name][:] for name in ("u", "dt", "f"))
    k, x = given.attrs["k"], given["x"][:]
with h5netcdf.File(target, "w") as result:
    result.dimensions = {{"member": len(u), "x": len(x)}}
    {fault}
    found = result.create_variable("u", ("member", "x"), data=u + dt[:, None] * (f[:, None] - k*u))
    found.attrs["units"] = "m"
"""
GRID = Grid((Axis("x", 1.0, 4),))
LAYOUT = Layout(("u", "v"), ("x",), {"x": ("x", np.arange(4) / 4)}, {"u": "m"})
PARAMETERS = {"k": 2.0}


@pytest.fixture(autouse=True)
def nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    yield
    assert not list(scratch.iterdir())


def opened(words: list[str], template: Path | None = None, **over: Any) -> SteppedProgram:
    path = None if template is None else str(template)
    options: dict[str, Any] = {"seconds": 20.0, "layout": LAYOUT, "place": PLACE} | over
    given = CommandWords(tuple(words), path, **options)
    return SteppedProgram(open_command(given), GRID, keep=False)


def text_program(folder: Path, fault: str = "", **over: Any) -> SteppedProgram:
    (folder / "solver.py").write_text(TEXT.format(fault=fault))
    (folder / "input.j2").write_text(TEMPLATE)
    words = [*PYTHON, str(folder / "solver.py"), "{input}", "{output}"]
    return opened(words, folder / "input.j2", **over)


def stepped(program: SteppedProgram, states: np.ndarray, inputs: Any = None) -> np.ndarray:
    t, dt = np.arange(float(len(states))), np.full(len(states), 0.1)
    return program.step(states, t, dt, inputs or {}, PARAMETERS)


def states_of(members: int) -> np.ndarray:
    return 1 + np.random.default_rng(1).random((members, 2, 4))


def test_text_is_written_by_a_template_and_read_as_columns(tmp_path: Path) -> None:
    program, states = text_program(tmp_path), states_of(3)
    use_threads(2)
    try:
        found = stepped(program, states)
    finally:
        use_threads(1)
    np.testing.assert_array_equal(found[:, 0], states[:, 0] * np.exp(-0.2))
    np.testing.assert_array_equal(found[:, 1], states[:, 1] + 0.1)
    assert not program.conduct.many and 0 < program.seconds < 5


def netcdf_program(folder: Path, fault: str = "") -> SteppedProgram:
    (folder / "solver.py").write_text(NETCDF.format(fault=fault))
    layout = replace(LAYOUT, fields=("u",))
    words = [sys.executable, str(folder / "solver.py"), "{input}", "{output}"]
    return opened(words, layout=layout)


def test_netcdf_has_a_batch_of_states(tmp_path: Path) -> None:
    program, states = netcdf_program(tmp_path), states_of(5)[:, :1]
    f = np.arange(5.0)
    found = stepped(program, states, {"f": f})
    np.testing.assert_allclose(found, 0.8 * states + 0.1 * f[:, None, None], rtol=1e-14)
    assert program.conduct.many


def test_netcdf_of_nodes_has_their_coordinates(tmp_path: Path) -> None:
    batch = StateBatch(states_of(2), np.zeros(2), np.ones(2), {}, {})
    places = {"x": ("node", np.arange(4.0)), "y": ("node", np.arange(4.0) ** 2)}
    layout = replace(LAYOUT, dimensions=("node",), coordinates=places)
    InputWriter(layout).write(tmp_path / "input.nc", batch)
    with h5netcdf.File(tmp_path / "input.nc") as file:
        assert file["u"].dimensions == ("member", "node")
        np.testing.assert_array_equal(file["y"][:], np.arange(4.0) ** 2)
    np.testing.assert_array_equal(read_output(tmp_path / "input.nc", 2, layout), batch.states)


def test_what_an_output_in_netcdf_lacks_is_told(tmp_path: Path) -> None:
    half = "result.close(); open(target, 'r+b').truncate(200); sys.exit()"
    for fault, said in {
        half: "writes an output that cannot be read: ",
        "sys.exit()": "python.* solver.py {input} {output} returns no field u",
        "raise KeyError('mesh')": "fails with exit code 1; it said:\n    Traceback(.|\n)*'mesh'",
    }.items():
        with pytest.raises(InputError, match=said):
            stepped(netcdf_program(tmp_path, fault), states_of(1)[:, :1], {"f": np.ones(1)})


FAULTS = {
    "print('lost', file=sys.stderr); sys.exit(3)": "fails with exit code 3; it said:\n    lost",
    "print('on stdout'); sys.exit(1)": "exit code 1; it said:\n    on stdout",
    "import os; os.abort()": "fails with signal SIGABRT",
    "sys.exit()": "ends without an error, but writes no output",
    "result = result[:2]": "writes 2 lines of numbers instead of 4",
    "result[1] = (math.nan, 1)": "returns values of u that are not finite, at t = 0",
    "open(target, 'w').write('1 2\\n3\\n5 6\\n7 8'); sys.exit()": "writes 1 numbers in line 2 of 4",
    "open(target, 'w').write('1 x\\n' * 4); sys.exit()": "writes 'x' where a number should be",
    "open(target, 'w').write('w v\\n'); sys.exit()": "writes no column u, but w, v",
    "open(target, 'wb').write(bytes([200, 1])); sys.exit()": "writes an output that is not text",
    "result = [(1, 2)] * 4": "returns the same for different states",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_program_that_fails_is_told_in_its_own_words(tmp_path: Path, fault: str) -> None:
    program = text_program(tmp_path, fault)
    with pytest.raises(InputError, match=FAULTS[fault]) as error:
        stepped(program, states_of(1))
    assert str(error.value).startswith(f"{PLACE}: {Path(sys.executable).name} -S -E solver.py")


def test_a_program_that_hangs_is_ended_with_all_it_has_started(tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    fault = (
        "import os, subprocess, time; "
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)']); "
        f"open({str(pids)!r}, 'w').write(f'{{os.getpid()}} {{child.pid}}'); "
        "print('waits', file=sys.stderr, flush=True); time.sleep(60)"
    )
    began = time.monotonic()
    says = r"has not ended after 1 s \([^ ]+ s of CPU\); it said:\n    waits\n  raise"
    with pytest.raises(InputError, match=says):
        stepped(text_program(tmp_path, fault, seconds=1.0), states_of(1))
    assert time.monotonic() - began < 10
    for pid in pids.read_text().split():
        assert not is_running(int(pid))


def test_a_program_that_nobody_waits_for_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "dashred.physics.external.adapters.command.process.is_given_up", lambda: True
    )
    began = time.monotonic()
    with pytest.raises(InputError, match="has not ended"):
        stepped(text_program(tmp_path, "import time; time.sleep(60)"), states_of(1))
    assert time.monotonic() - began < 5


def is_running(pid: int) -> bool:
    for _ in range(100):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return False
        if state == "Z":
            return False
        time.sleep(0.02)
    return True


def test_a_state_that_fails_later_is_nan(tmp_path: Path) -> None:
    program = text_program(tmp_path, "if rows[0][0] > 5: sys.exit('diverged')")
    states = states_of(3)
    stepped(program, states[:1])
    states[1, 0, 0] = 9
    found = stepped(program, states)
    np.testing.assert_array_equal(np.isnan(found).all(axis=(1, 2)), [False, True, False])
    assert program.failure is not None
    assert program.failure.endswith("fails with exit code 1; it said:\n    diverged")


def test_fortran_writes_exponents_with_d(tmp_path: Path) -> None:
    lines = "(f'{u:.9E} {v:.9E}\\n'.replace('E', 'D') for u, v in result)"
    fault = f"open(target, 'w').writelines({lines}); sys.exit()"
    states = states_of(1)
    found = stepped(text_program(tmp_path, fault), states)
    np.testing.assert_allclose(found[:, 1], states[:, 1] + 0.1, rtol=1e-9)


def test_a_template_reads_what_it_is_given_and_calls_nothing_else(tmp_path: Path) -> None:
    program = tmp_path / "solver"
    program.write_text("")
    program.chmod(0o700)
    words = [str(program), "{input}", "{output}"]
    for text, said in {
        "{{ w }}": "fails: UndefinedError: 'w' is undefined\n  it has: x, u, v, k, t, dt",
        "{{ u.__class__.__mro__ }}": "fails: SecurityError",
        "{{ u": r"input.j2:1: not a Jinja2 template",
    }.items():
        path = tmp_path / "input.j2"
        path.write_text(text)
        with pytest.raises(InputError, match=said):
            stepped(opened(words, path), states_of(1))
    with pytest.raises(InputError, match=r"absent.j2: the template cannot be read: No such file"):
        opened(words, tmp_path / "absent.j2")


def test_a_command_that_cannot_be_started_is_told(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.write_text("text")
    for words, said in {
        ("no-such-program", "{input}", "{output}"): "the program no-such-program does not exist",
        (str(plain), "{input}", "{output}"): f"the program {plain} is not executable\n  chmod",
        (sys.executable, "{output}"): "the command has no {input}",
        (sys.executable, "{input}"): "the command has no {output}",
    }.items():
        with pytest.raises(InputError, match=f"{PLACE}: {said}"):
            opened(list(words))
    os.chmod(plain, 0o700)
    with pytest.raises(InputError, match="cannot be started: Exec format error"):
        stepped(opened([str(plain), "{input}", "{output}"]), states_of(1))
