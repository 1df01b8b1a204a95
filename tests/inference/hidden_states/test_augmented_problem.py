"""Hidden states at the samples, and the change of a time constant."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.inference.hidden_states.augmented_problem import decay, hidden_course
from dashred.inference.hidden_states.segment_fit import FARTHEST, changed_tau
from dashred.inference.segments.segments import Segments, cut
from dashred.physics.hidden_state import relax

CLOCKS = [np.linspace(0, 3, 31), np.linspace(5, 7, 15)]
TAU = 0.8


@pytest.fixture
def segments() -> Segments:
    return cut(CLOCKS, [np.zeros((len(clock), 1)) for clock in CLOCKS])


def test_a_hidden_state_begins_anew_in_every_episode(segments: Segments) -> None:
    found = hidden_course(segments, np.sin(segments.times), TAU)
    for episode, clock in enumerate(CLOCKS):
        exact = relax(clock, np.sin(clock), TAU)
        assert segments.join(found, episode) == pytest.approx(exact, abs=1e-12)


def test_a_deviation_at_the_start_decays_in_every_episode(segments: Segments) -> None:
    left = decay(segments, TAU)
    for episode, clock in enumerate(CLOCKS):
        exact = np.exp(-(clock - clock[0]) / TAU)
        assert segments.join(left, episode) == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize("change", [-0.3, 0.0, 0.4])
def test_a_change_along_the_tangent_is_another_time_constant(change: float) -> None:
    tau, difference = 0.8, 1.7
    rate = difference / tau - change * difference / tau**2
    assert difference / changed_tau(tau, change) == pytest.approx(rate)


def test_a_rate_below_zero_gives_a_bounded_time_constant() -> None:
    assert changed_tau(0.8, 2.0) == pytest.approx(FARTHEST * 0.8)
