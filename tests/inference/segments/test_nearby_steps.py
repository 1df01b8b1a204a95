"""Steps of an expensive program from those of states nearby."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from dashred.inference.segments.nearby_steps import NearbySteps, step_of
from dashred.inference.segments.program_step import ProgramStep
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
        found, _ = steps.linearise(0, close, TIMES, STEPS, {})
        np.testing.assert_array_equal(steps.advance(close, TIMES, STEPS, {}), found)
        errors.append(np.abs(found - exact.advance(close, TIMES, STEPS, {})).max())
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
    steps.advance(NODES, TIMES + 0.1, STEPS, {})
    assert program.states == [9, 3, 3]


def test_a_state_that_cannot_be_stepped_is_not_used_again() -> None:
    program = Counted()
    lost = NODES.copy()
    lost[1] = np.nan
    steps = nearby(program)
    ends, _ = steps.linearise(0, lost, TIMES, STEPS, {})
    assert np.isnan(ends[1]).all()
    assert np.isfinite(ends[[0, 2]]).all()
    steps.advance(NODES, TIMES, STEPS, {})
    assert program.states == [9, 1]


@pytest.mark.parametrize(("seconds", "kind"), [(0.001, ProgramStep), (0.5, NearbySteps)])
def test_only_an_expensive_program_is_spared(seconds: float, kind: type) -> None:
    assert isinstance(step_of(Counted(seconds), {"g": 4.0}), kind)
