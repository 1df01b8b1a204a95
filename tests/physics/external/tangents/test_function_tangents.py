"""A function that offers its tangents: they take the place of differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from dashred.core.errors import InputError
from dashred.inference.segments.steps.program_step import ProgramStep
from dashred.physics.external.adapters.function import FunctionAdapter
from dashred.physics.external.partial import PartialProgram
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.external.tangents.checked_tangents import CheckedTangents
from dashred.physics.external.tangents.function_tangents import find_jvp
from dashred.physics.grids.grid import Grid
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.tangents.program_tangents import tangent_program
from tests.programs import swing, swing_jvp

TIMES = torch.linspace(0, 2, 21, dtype=torch.float64)
SYSTEM = """
    fields: {theta: angle, omega: rate}
    parameters: {g: 4.0}
    simulator: {function: tests.programs.NAME}
    start: {theta: 1.2, omega: 0.3}
    integrator: {dt: 0.05}
"""
GIVEN: dict[str, Any] = {"inputs": {}, "parameters": {"g": 4.0}}


class Swing:
    """The function, which counts its calls."""

    def __init__(self, jvp: Any = None, step: Any = swing) -> None:
        self.calls, self.step = 0, step
        if jvp is not None:
            self.jvp = jvp

    def __call__(self, *given: Any) -> dict[str, Any]:
        """Return a step."""
        self.calls += 1
        return self.step(*given)


def opened(function: Swing) -> SteppedProgram:
    adapter = FunctionAdapter(function, ("theta", "omega"), "swings.step", "mine.yaml:7")
    program = SteppedProgram(adapter, Grid(()), keep=False)
    if (offered := adapter.with_tangents()) is not None:
        tangent = SteppedProgram(offered, Grid(()), keep=False)
        program.tangent = CheckedTangents(tangent, program, offered.name, "mine.yaml:7")
    return program


def test_a_jvp_is_an_attribute_or_beside_the_function(monkeypatch: pytest.MonkeyPatch) -> None:
    assert find_jvp(Swing(swing_jvp), "swings.step") is swing_jvp
    assert find_jvp(Swing(), "swings.step") is None
    monkeypatch.setattr("tests.programs.jvp", swing_jvp, raising=False)
    assert find_jvp(Swing(), "tests.programs.swing") is swing_jvp
    monkeypatch.setattr("tests.programs.jvp", torch.func.jvp)
    assert find_jvp(Swing(), "tests.programs.swing") is None


def test_the_columns_are_those_of_differences(make_system: Any) -> None:
    found = []
    for name in ("swing", "swing_with_tangents"):
        system = make_system(
            SYSTEM.replace("NAME", name), f"trust=tests.programs.{name}", "recording.path=r.csv"
        )
        assert (system.program.tangent is None) == (name == "swing")
        start, eye = nominal_start(system)[0], torch.eye(2, dtype=torch.float64)
        states, columns = zip(*tangent_program(system, start, eye, TIMES, None, []), strict=True)
        found.append((torch.stack(states), torch.stack(columns)))
    torch.testing.assert_close(found[0][0], found[1][0], rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(found[0][1], found[1][1], rtol=1e-3, atol=1e-3)
    assert not torch.equal(found[0][1], found[1][1])


def test_the_function_is_not_called_for_differences() -> None:
    plain, offered = Swing(), Swing(swing_jvp)
    steps = [ProgramStep(opened(each), GIVEN["parameters"]) for each in (plain, offered)]
    rng, calls, jacobians = np.random.default_rng(1), [], []
    each = np.full(5, 0.1)
    for _ in range(3):  # The first calls examine the function.
        states = rng.standard_normal((5, 2))
        before = plain.calls, offered.calls
        jacobians = [step.linearise(0, states, each, each, {})[1] for step in steps]
        calls.append((plain.calls - before[0], offered.calls - before[1]))
    np.testing.assert_allclose(jacobians[0], jacobians[1], rtol=0, atol=1e-6)
    assert calls[-1][0] >= 1 and calls[-1][1] == 0


def test_a_wrong_jvp_is_refused() -> None:
    def wrong(*given: Any) -> Any:
        after, moved = swing_jvp(*given)
        return after, {**moved, "omega": 2 * moved["omega"]}

    step = ProgramStep(opened(Swing(wrong)), GIVEN["parameters"])
    with pytest.raises(InputError, match="returns differs from that of the program"):
        step.linearise(0, np.ones((1, 2)), np.zeros(1), np.full(1, 0.1), {})


def saturated(state: Any, t: Any, dt: Any, inputs: Any, parameters: Any) -> Any:
    """Step a concentration of about 1e-3, which decays faster at a high pressure in Pa."""
    p, c = state["theta"], state["omega"]
    return {"theta": p, "omega": c / (1 + 1e-5 * p * dt + 1e3 * c * dt)}


def saturated_jvp(state: Any, t: Any, dt: Any, inputs: Any, parameters: Any, moved: Any) -> Any:
    after = saturated(state, t, dt, inputs, parameters)
    p, c = state["theta"], state["omega"]
    below = 1 + 1e-5 * p * dt + 1e3 * c * dt
    change = (1 + 1e-5 * p * dt) * moved["omega"] - 1e-5 * dt * c * moved["theta"]
    return after, {"theta": moved["theta"], "omega": change / below**2}


def test_a_small_field_is_compared_in_its_own_size() -> None:
    tangent = opened(Swing(saturated_jvp, saturated)).tangent
    assert tangent is not None
    state = np.array([[1e5, 1e-3, 0.0, 1.0]])
    found = tangent.step(state, np.zeros(1), np.full(1, 0.1), **GIVEN)
    assert found[0, 3] == pytest.approx(1.1 / 1.2**2)


def test_states_that_are_lost_have_lost_tangents() -> None:
    tangent, clock = opened(Swing(swing_jvp)).tangent, (np.zeros(1), np.full(1, 0.1))
    assert tangent is not None
    tangent.step(np.array([[1.0, 1.0, 0.0, 0.0]]), *clock, **GIVEN)
    found = tangent.step(np.full((1, 4), np.nan), *clock, **GIVEN)
    assert np.isnan(found).all()


def test_a_jvp_that_returns_no_tangent_is_refused() -> None:
    step = ProgramStep(opened(Swing(lambda *given: swing(*given[:-1]))), GIVEN["parameters"])
    with pytest.raises(InputError, match="returns dict, not a state and a tangent"):
        step.linearise(0, np.ones((1, 2)), np.zeros(1), np.full(1, 0.1), {})


def test_fields_that_the_program_does_not_step_keep_their_tangents() -> None:
    partial = PartialProgram(opened(Swing(swing_jvp)), [0, 2], 3)
    assert partial.tangent is not None
    states = np.array([[1.0, 7.0, 0.3, 0.5, 3.0, 0.0]])
    found = partial.tangent.step(states, np.zeros(1), np.full(1, 0.1), **GIVEN)
    expected = swing_jvp(
        {"theta": 1.0, "omega": 0.3}, 0.0, 0.1, {}, {"g": 4.0}, {"theta": 0.5, "omega": 0.0}
    )
    np.testing.assert_allclose(found[0, [0, 2]], [*expected[0].values()])
    np.testing.assert_allclose(found[0, [3, 5]], [*expected[1].values()])
    assert found[0, 1] == 7.0 and found[0, 4] == 3.0
