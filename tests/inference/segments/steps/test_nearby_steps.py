"""Steps of an expensive program from those of states nearby."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from dashred.inference.segments.steps.nearby_steps import NearbySteps, step_of
from dashred.inference.segments.steps.program_step import ProgramStep
from dashred.physics.external.protocol import Array
from tests.programs import pendulum

TIMES, STEPS = np.array([0.0, 0.3, 0.6]), np.full(3, 0.3)
NODES = np.array([[1.2, 0.3], [-0.7, 1.0], [2.0, -1.5]])


@dataclass(eq=False)
class Counted:
    """A pendulum that counts the states it has stepped."""

    seconds: float = 1.0
    rounding: float = 1e-16
    sha256: str = ""
    failure: str | None = None
    tangent: None = None
    states: list[int] = field(default_factory=list)

    def seconds_of(self, count: int) -> float:
        """See :class:`Program`."""
        return count * self.seconds

    def forget_failures(self) -> None:
        """See :class:`Program`."""
        self.failure = None

    def step(
        self,
        states: Array,
        t: Array,
        dt: Array,
        inputs: Mapping[str, Array],
        parameters: Mapping[str, float],
    ) -> Array:
        """See :class:`Program`."""
        self.states.append(len(states))
        named = {"theta": states[:, 0], "omega": states[:, 1]}
        found = pendulum(named, t, dt, inputs, parameters)
        return np.stack([found["theta"], found["omega"]], axis=1)


def nearby(program: Counted) -> NearbySteps:
    step = step_of(program, {"g": 4.0})
    assert isinstance(step, NearbySteps)
    return step


def test_the_error_is_of_second_order_and_the_program_is_not_called() -> None:
    program = Counted()
    steps, exact = nearby(program), ProgramStep(Counted(), {"g": 4.0})
    steps.linearise(0, NODES, TIMES, STEPS, {})
    assert program.states == [9]
    errors = []
    for distance in (0.02, 0.01):
        close = NODES + distance
        found, *_ = steps.linearise(0, close, TIMES, STEPS, {})
        np.testing.assert_array_equal(steps.advance(0, close, TIMES, STEPS, {}), found)
        errors.append(np.abs(found - exact.advance(0, close, TIMES, STEPS, {})).max())
    assert program.states == [9]
    assert errors[0] < 1e-3
    assert 3.5 < errors[0] / errors[1] < 4.5


def test_steps_far_away_or_at_another_time_are_exact_and_shared_by_all_segments() -> None:
    program = Counted()
    nearby(program).linearise(0, NODES, TIMES, STEPS, {})
    steps, exact = nearby(program), ProgramStep(Counted(), {"g": 4.0})
    moved = NODES + np.array([[0.0], [0.0], [0.5]])
    found = steps.linearise(0, moved, TIMES, STEPS, {})
    assert program.states == [9, 3]
    known = exact.linearise(0, moved, TIMES, STEPS, {})
    np.testing.assert_allclose(found[0], known[0], rtol=1e-14)
    np.testing.assert_allclose(found[1], known[1], atol=1e-6)
    steps.advance(0, NODES, TIMES + 0.1, STEPS, {})
    assert program.states == [9, 3, 3]


def test_steps_are_used_again_at_a_changed_parameter() -> None:
    program, errors = Counted(), []
    step = nearby(program)
    step.at({"g": 0.5}).linearise(0, NODES, TIMES, STEPS, {})
    # Three states, two changes of each, and one of the parameter.
    assert program.states == [9, 3]
    for change in (0.04, 0.02):
        moved, exact = step.at({"g": 0.5 + change}), ProgramStep(Counted(), {"g": 4.5 + change})
        found, jacobians, slopes = moved.linearise(0, NODES + change / 4, TIMES, STEPS, {})
        errors.append(np.abs(found - exact.advance(0, NODES + change / 4, TIMES, STEPS, {})).max())
        assert jacobians.shape == (3, 2, 2) and slopes.shape == (3, 2, 1)
    assert program.states == [9, 3]
    assert errors[0] < 1e-3
    assert 3.5 < errors[0] / errors[1] < 4.5
    step.at({"g": 1.0}).linearise(0, NODES, TIMES, STEPS, {})
    assert program.states == [9, 3, 9, 3]


def test_derivatives_are_used_again_near_and_the_states_stay_exact() -> None:
    program = Counted(seconds=0.001)
    step = step_of(program, {"g": 4.0})
    first = step.at({"g": 0.5}).linearise(0, NODES, TIMES, STEPS, {})
    program.states.clear()
    close, exact = step.at({"g": 0.51}), ProgramStep(Counted(), {"g": 4.51})
    after, jacobians, slopes = close.linearise(0, NODES * 1.002, TIMES, STEPS, {})
    assert program.states == [3]
    np.testing.assert_array_equal(jacobians, first[1])
    np.testing.assert_array_equal(slopes, first[2])
    np.testing.assert_array_equal(after, exact.advance(0, NODES * 1.002, TIMES, STEPS, {}))
    # Only the segment that moves is differentiated anew.
    far = NODES * np.array([[1.002], [1.002], [1.2]])
    program.states.clear()
    _, jacobians, slopes = close.linearise(0, far, TIMES, STEPS, {})
    assert program.states == [5, 1]
    np.testing.assert_array_equal(jacobians[:2], first[1][:2])
    ends = [
        ProgramStep(Counted(), {"g": 4.51 + change}).advance(0, far, TIMES, STEPS, {})[2]
        for change in (1e-5, -1e-5)
    ]
    np.testing.assert_allclose(slopes[2, :, 0], (ends[0] - ends[1]) / 2e-5, rtol=1e-4)


def test_what_a_run_has_stepped_is_not_stepped_again() -> None:
    program = Counted(seconds=0.001)
    step = step_of(program, {"g": 4.0})
    first = step.linearise(0, NODES, TIMES, STEPS, {})
    ends = step.advance(0, NODES * 1.2, TIMES, STEPS, {})
    program.states.clear()
    after, *_ = step.linearise(0, NODES * 1.2, TIMES, STEPS, {})
    assert program.states == [6]
    np.testing.assert_array_equal(after, ends)
    step.advance(0, NODES, TIMES, STEPS, {})
    program.states.clear()
    again = step.linearise(0, NODES, TIMES, STEPS, {})
    assert program.states == [6]
    for found, expected in zip(again, first, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-14)
    # The parameter is another one.
    step.at({"g": 0.001}).linearise(0, NODES, TIMES, STEPS, {})
    assert program.states == [6, 3, 3]
    step.advance(0, NODES, TIMES, STEPS, {})
    program.states.clear()
    step.linearise(0, NODES, TIMES, STEPS, {})
    assert program.states == []


def test_a_state_that_cannot_be_stepped_is_not_used_again() -> None:
    program = Counted()
    lost = NODES.copy()
    lost[1] = np.nan
    steps = nearby(program)
    ends, *_ = steps.linearise(0, lost, TIMES, STEPS, {})
    assert np.isnan(ends[1]).all()
    assert np.isfinite(ends[[0, 2]]).all()
    steps.advance(0, NODES, TIMES, STEPS, {})
    assert program.states == [9, 1]


@pytest.mark.parametrize(("seconds", "kind"), [(0.001, ProgramStep), (0.5, NearbySteps)])
def test_only_an_expensive_program_is_spared(seconds: float, kind: type) -> None:
    assert isinstance(step_of(Counted(seconds), {"g": 4.0}), kind)
