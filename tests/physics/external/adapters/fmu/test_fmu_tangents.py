"""Columns of an FMU for model exchange from its directional derivatives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from dashred.inference.segments.steps.program_step import ProgramStep
from dashred.physics.external.adapters.fmu.description import read_description
from dashred.physics.external.adapters.fmu.fmu import FmuAdapter
from dashred.physics.external.adapters.fmu.fmu_tangents import FmuTangents
from dashred.physics.external.state_batch import StateBatch
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.grids.grid import Grid
from tests.physics.external.adapters.fmu.build import build

MU, DT = 1.5, 0.4
PARAMETERS = {"k": 1.0, "c": MU, "n": 0.0}
STATES = np.array([[1.0, 0.5], [0.3, -2.0], [-2.1, 1.0]])
CLOCK: tuple[Any, Any, Any] = (np.zeros(3), np.full(3, DT), {"f": np.zeros(3)})


class Counted(FmuAdapter):
    """The FMU, which counts its steps."""

    steps = 0

    def step(self, given: Any) -> Any:
        """Step a state."""
        self.steps += 1
        return super().step(given)


def opened(path: Path) -> tuple[Counted, SteppedProgram]:
    description = read_description(
        str(path), ["x", "v"], ["k", "c", "n", "f"], {"v": "body.v"}, None, "mine.yaml:5"
    )
    adapter = Counted(description, ["x", "v"], "mine.yaml:5")
    program = SteppedProgram(adapter, Grid(()), keep=False)
    if adapter.offers_derivatives:
        program.tangent = SteppedProgram(FmuTangents(adapter), Grid(()), keep=False)
    return adapter, program


def jacobians_of(program: SteppedProgram) -> np.ndarray:
    return ProgramStep(program, PARAMETERS).linearise(0, STATES, *CLOCK)[1]


def analytic() -> np.ndarray:
    """Return the Jacobians of a step of van der Pol's oscillator by its own equations."""

    def rates(t: float, joined: np.ndarray) -> np.ndarray:
        (x, v), moved = joined[:2], joined[2:].reshape(2, 2)
        slopes = np.array([[0, 1], [-1 - 2 * MU * x * v, MU * (1 - x**2)]])
        return np.concatenate([[v, MU * (1 - x**2) * v - x], (slopes @ moved).ravel()])

    found = []
    for state in STATES:
        start = np.concatenate([state, np.eye(2).ravel()])
        run = solve_ivp(rates, (0, DT), start, rtol=1e-11, atol=1e-12)
        found.append(run.y[2:, -1].reshape(2, 2))
    return np.array(found)


@pytest.mark.parametrize("version", [2, 3])
def test_the_columns_are_analytic_and_take_no_differences(tmp_path: Path, version: int) -> None:
    adapter, program = opened(build(tmp_path, version, bent=1, derivatives=1, offers=True))
    adapter.step(adapter.given(StateBatch(STATES, *CLOCK, PARAMETERS), 0))
    x, v = STATES[1]
    rates, slopes = adapter.instance.slopes_along(0.0, STATES[1], np.eye(2))
    np.testing.assert_allclose(rates, [v, MU * (1 - x**2) * v - x])
    expected = np.array([[0, 1], [-1 - 2 * MU * x * v, MU * (1 - x**2)]])
    np.testing.assert_allclose(slopes, expected)
    jacobians_of(program)  # the first steps examine the FMU
    adapter.steps = 0
    np.testing.assert_allclose(jacobians_of(program), analytic(), atol=2e-6)
    assert adapter.steps == 0


def test_columns_without_directional_derivatives_are_differences(tmp_path: Path) -> None:
    adapter, program = opened(build(tmp_path, 2, bent=1, derivatives=1))
    assert program.tangent is None
    jacobians_of(program)  # the first steps measure its rounding errors
    np.testing.assert_allclose(jacobians_of(program), analytic(), atol=1e-5)
    assert adapter.steps > 9


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (None, "says that it has directional derivatives, but fails"),
        (1.2, "are not those of its derivatives"),
    ],
)
def test_an_error_and_a_wrong_derivative_are_told_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], version: int, factor: Any, said: str
) -> None:
    path = build(tmp_path, version, bent=1, derivatives=factor, offers=True)
    adapter, program = opened(path)
    for _ in range(2):
        np.testing.assert_allclose(jacobians_of(program), analytic(), atol=1e-5)
    told = capsys.readouterr().out
    assert told.count("differences are used in their place") == 1 and said in told
    assert adapter.steps > 9


def test_a_step_with_an_event_takes_differences(tmp_path: Path) -> None:
    """A free body that bounces at x = -0.5: the tangent jumps with v."""
    _, program = opened(build(tmp_path, 2, events=1, derivatives=1, offers=True))
    free = {"k": 0.0, "c": 0.0, "n": 0.0}
    states = np.array([[-0.3, -1.0], [2.0, 1.0]])
    each = np.ones(2)
    clock: Any = (0 * each, 0.5 * each, {"f": 0 * each})
    found = ProgramStep(program, free).linearise(0, states, *clock)[1]
    # It bounces after the time (x + 0.5) / -v, and goes back with -0.7 v.
    np.testing.assert_allclose(found[0], [[-0.7, -0.35], [0.0, -0.7]], atol=1e-5)
    np.testing.assert_allclose(found[1], [[1.0, 0.5], [0.0, 1.0]], atol=1e-12)


def test_many_directions_and_few(tmp_path: Path) -> None:
    """A linear FMU: the tangents are those of the exponential of its matrix."""
    _, program = opened(build(tmp_path, 3, derivatives=1, offers=True))
    assert program.tangent is not None
    tangents = np.random.default_rng(1).standard_normal((3, 2))
    joined = np.concatenate([np.tile(STATES[0], (3, 1)), tangents], axis=1)
    found = program.tangent.step(joined, *CLOCK, PARAMETERS)
    exact = expm(DT * np.array([[0, 1], [-1, -MU]]))
    np.testing.assert_allclose(found[:, 2:], tangents @ exact.T, atol=1e-8)
    np.testing.assert_allclose(found[:, :2], np.tile(exact @ STATES[0], (3, 1)), atol=1e-8)
