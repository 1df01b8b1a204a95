"""FMUs as programs: FMI 2 and 3, model exchange and co-simulation, events, and refusals."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from dashred.core.errors import InputError
from dashred.physics.external.adapters.fmu.description import read_description
from dashred.physics.external.adapters.fmu.fmu import FmuAdapter
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.grids.grid import Grid
from tests.physics.external.adapters.fmu.build import build

PLACE = "mine.yaml:5"
VARIABLES = {"v": "body.v"}
PARAMETERS = {"k": 3.0, "c": 0.5, "n": 2.0}
STATES = np.array([[1.0, 0.0], [0.3, -2.0], [-0.2, 1.0]])


def opened(path: Path, fields: str = "x v", others: str = "k c n f", **over: Any) -> SteppedProgram:
    given = {"variables": VARIABLES, "interface": None, "place": PLACE} | over
    description = read_description(str(path), fields.split(), others.split(), **given)
    adapter = FmuAdapter(description, fields.split(), PLACE)
    return SteppedProgram(adapter, Grid(()), keep=False)


def stepped(
    program: SteppedProgram, parameters: dict[str, float] = PARAMETERS, dt: float = 0.2
) -> np.ndarray:
    each = np.ones(3)
    f = np.array([0.0, 1.0, -1.0])
    return program.step(STATES, np.arange(3.0), dt * each, {"f": f}, parameters)


def exact(parameters: dict[str, float], dt: float = 0.2) -> np.ndarray:
    """Solution by the exponential of the linear system (x, v, time, 1)."""
    k, c, n = parameters["k"], parameters["c"], parameters["n"]
    found = []
    for row, f in enumerate([0.0, 1.0, -1.0]):
        matrix = np.array([[0, 1, 0, 0], [-k, -c, n, f], [0, 0, 0, 1], [0, 0, 0, 0]])
        found.append((expm(dt * matrix) @ [*STATES[row], row, 1])[:2])
    return np.array(found)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("interface", ["model-exchange", "co-simulation"])
def test_an_fmu_is_stepped_from_any_state(tmp_path: Path, version: int, interface: str) -> None:
    program = opened(build(tmp_path, version), interface=interface)
    tolerance = 1e-8 if interface == "model-exchange" else 1e-6
    for parameters in (PARAMETERS, PARAMETERS | {"k": 9.0, "n": 0.0}):
        np.testing.assert_allclose(stepped(program, parameters), exact(parameters), atol=tolerance)
    assert program.conduct.many and program.rounding < 1e-14


@pytest.mark.parametrize("version", [2, 3])
def test_an_event_is_found_within_a_step(tmp_path: Path, version: int) -> None:
    """A bounce at x = -0.5 of a free body: v becomes -0.7 v."""
    program = opened(build(tmp_path, version, events=1))
    parameters = {"k": 0.0, "c": 0.0, "n": 0.0}
    state = np.array([[-0.3, -1.0], [2.0, 1.0]])
    each = np.ones(2)
    found = program.step(state, 0 * each, 0.5 * each, {"f": 0 * each}, parameters)
    np.testing.assert_allclose(found, [[-0.5 + 0.7 * 0.3, 0.7], [2.5, 1.0]], atol=1e-9)


def test_what_an_fmu_says_is_told(tmp_path: Path) -> None:
    program = opened(build(tmp_path, 2), interface="co-simulation")
    with pytest.raises(InputError, match=r"fails: .*; it said:\n    k must not be negative"):
        stepped(program, PARAMETERS | {"k": -1.0})
    stepped(program)
    assert np.isnan(stepped(program, dt=2.0)).all()
    assert str(program.failure).endswith("it said:\n    the step is longer than 1")
    with pytest.raises(InputError, match=r"takes no 1.5 for n, a Integer"):
        stepped(opened(build(tmp_path, 2)), PARAMETERS | {"n": 1.5})


def test_a_stiff_model_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"too stiff .*\n  shorten .*interface: co-simulation"):
        stepped(opened(build(tmp_path, 3)), PARAMETERS | {"c": 1e9})


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "field": ({"fields": "x w"}, "has no variable w\n .*variables: {w: NAME}"),
    "parameter": ({"others": "k cc"}, r"has no variable cc\n  did you mean c\?"),
    "state": ({"fields": "x"}, "has the state body.v, which is not a field"),
    "no state": ({"fields": "x v f"}, "f is not a state\n  its states: x, body.v"),
    "type": ({"fields": "x v n"}, "n is Integer, but the field n is a real number"),
    "kind": ({"kinds": "CoSimulation", "interface": "model-exchange"}, "offers co-simulation, not"),
    "none": ({"kinds": ""}, "offers neither model exchange nor co-simulation"),
    "platform": ({"platform": "win64"}, "has (no binaries|binaries for .*, not) for"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_fmu_that_cannot_be_used_is_refused(tmp_path: Path, case: str) -> None:
    given, said = REFUSED[case]
    how = {key: given[key] for key in given if key in ("kinds", "platform")}
    path = build(tmp_path, 2, **how)
    with pytest.raises(InputError, match=f"{PLACE}: oscillator2.fmu:? {said}"):
        opened(path, **{key: value for key, value in given.items() if key not in how})


def test_a_file_that_is_no_fmu_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    with pytest.raises(InputError, match=r"absent.fmu: there is no such file"):
        opened(tmp_path / "absent.fmu")
    (tmp_path / "text.fmu").write_text("no archive")
    with pytest.raises(InputError, match=r"text.fmu: not a readable FMU: File is not a zip file"):
        opened(tmp_path / "text.fmu")


def test_nothing_is_left_of_an_fmu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    program = opened(build(tmp_path, 2))
    stepped(program)
    assert list(scratch.iterdir())
    del program
    assert not list(scratch.iterdir())
