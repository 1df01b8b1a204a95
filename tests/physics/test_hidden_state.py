"""A state that follows a quantity of the system with a delay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dashred.physics.hidden_state import (
    HiddenState,
    followed_by,
    relax,
    with_hidden_states,
    without_hidden_state,
)
from dashred.physics.system import System
from tests import laws

STATE = HiddenState("z", "tau_z", "omega", 0.5, "0", 1.0, 0.2)


@pytest.fixture
def pendulum(tmp_path: Path) -> System:
    return laws.declared(tmp_path, laws.PENDULUM)


def test_it_relaxes_exactly_toward_a_ramp() -> None:
    times, tau = np.array([0.0, 0.3, 1.0, 1.1, 4.0]), 0.7
    follows = 2.0 + 3.0 * times
    exact = follows - 3.0 * tau * (1 - np.exp(-times / tau))
    assert relax(times, follows, tau) == pytest.approx(exact, abs=1e-12)


def test_a_system_with_it_has_one_more_field_that_does_not_act(pendulum: System) -> None:
    config = replace(pendulum.config, units={"t": "s", "omega": "rad/s"})
    augmented = pendulum.with_config(with_hidden_states(config, [STATE]))
    assert augmented.fields == ("theta", "omega", "z")
    assert augmented.config.equations["z"] == "(omega - z)/tau_z"
    assert augmented.config.parameter_spread == {"tau_z": 0.2}
    assert augmented.units == {"t": "s", "omega": "rad/s", "z": "rad/s", "tau_z": "s"}
    for field in pendulum.fields:
        assert augmented.resolved[field] == pendulum.resolved[field]
    assert without_hidden_state(augmented.config, STATE) == config


def test_what_a_field_follows_is_read_off_its_equation(pendulum: System) -> None:
    augmented = pendulum.with_config(with_hidden_states(pendulum.config, [STATE]))
    assert followed_by(augmented, "z") == "omega"
    assert followed_by(augmented, "theta") is None
    assert followed_by(augmented, "omega") is None
