"""Time steps between output times."""

from __future__ import annotations

import math

import pytest

from dashred.physics.solvers.schedule import count_steps, schedule


@pytest.mark.parametrize("dt", [0.01, 0.03, 0.1, 0.7, 5.0])
@pytest.mark.parametrize("times", [[0.0, 0.1, 0.2, 0.3], [0.0, 1e-3, 2.0, 2.5], [3.0]])
def test_the_number_of_steps_is_that_of_the_schedule(times: list[float], dt: float) -> None:
    assert count_steps(times, dt) == len(list(schedule(times, dt)))


def test_without_a_time_step_each_interval_counts_as_one() -> None:
    assert count_steps([0.0, 1.0, 5.0], math.nan) == 2
