"""Laws that change at events, against exact solutions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dashred.evaluation.foreign.cases.mechanisms import MECHANISMS
from dashred.evaluation.foreign.cases.phases import Exit, Phase, integrate_phases


def motion(name: str, duration: float, **values: float):
    """Return the times, states and missing tendencies of a mechanism."""
    mechanism = MECHANISMS[name]
    given = {**mechanism.parameters, **mechanism.secret, **values}
    times = np.linspace(0, duration, 801)
    start = np.array(mechanism.start)
    phases = mechanism.phases(given)
    return times, *integrate_phases(mechanism.known(given), phases, mechanism.begin, start, times)


def values_of(name: str) -> dict[str, float]:
    """Return all values of a mechanism."""
    return {**MECHANISMS[name].secret, **MECHANISMS[name].parameters}


def test_a_ball_that_falls_and_stays_down() -> None:
    floor = Exit(lambda t, s: s[0], -1, lambda t, s: "down")
    phases = {
        "up": Phase(lambda t, s: np.array([0.0, -2.0]), (floor,)),
        "down": Phase(lambda t, s: np.array([-s[1], 0.0])),
    }
    times = np.linspace(0, 2, 21)
    states, lacking = integrate_phases(
        lambda t, s: np.array([s[1], 0.0]), phases, "up", np.array([1.0, 0.0]), times
    )
    np.testing.assert_allclose(states[:, 0], np.maximum(1 - times**2, 0), atol=1e-7)
    assert (lacking[times < 0.99, 1] == -2.0).all() and (lacking[times > 1.01, 1] == 0.0).all()


def test_a_phase_between_two_samples() -> None:
    """A particle moves at speed 1, 3 for a hundredth of a second, and 1 again."""
    phases = {
        "first": Phase(lambda t, s: np.ones(1), (Exit(lambda t, s: t - 0.62, 1, _to("fast")),)),
        "fast": Phase(lambda t, s: np.full(1, 3.0), (Exit(lambda t, s: t - 0.63, 1, _to("last")),)),
        "last": Phase(lambda t, s: np.ones(1)),
    }
    times = np.linspace(0, 1, 11)
    states, lacking = integrate_phases(
        lambda t, s: np.zeros(1), phases, "first", np.zeros(1), times
    )
    np.testing.assert_allclose(states[:, 0], times + np.where(times > 0.63, 0.02, 0), atol=1e-8)
    assert (lacking == 1).all()


def _to(name: str) -> Callable[[float, np.ndarray], str]:
    return lambda t, s: name


def test_dry_friction_takes_the_same_from_every_half_swing_and_then_sticks() -> None:
    times, states, lacking = motion("dry_friction", 40.0, c=0.0, k=4.0, mu=0.4)
    position, velocity = states.T
    # Turning points lie 2μ/k nearer to the middle than the ones before.
    turns = np.flatnonzero(np.diff(np.sign(velocity[:400])))[1:8]
    amplitudes = np.abs(position[turns])
    np.testing.assert_allclose(np.diff(amplitudes), -2 * 0.4 / 4.0, atol=0.02)
    assert (velocity[times > 30] == velocity[-1]).all() and abs(velocity[-1]) < 1e-6
    assert abs(position[-1]) <= 0.4 / 4.0 + 1e-6
    # While it sticks, friction balances the spring.
    np.testing.assert_allclose(lacking[-1, 1], 4.0 * position[-1], atol=1e-6)


def test_a_belt_carries_the_mass_until_the_spring_is_stronger() -> None:
    _, states, lacking = motion("stick_slip", 30.0)
    values = values_of("stick_slip")
    assert states[:, 1].max() <= values["V"] + 1e-6
    sticks = np.abs(states[:, 1] - values["V"]) < 1e-9
    assert 0.1 < sticks.mean() < 0.95
    force = values["k"] * states[sticks, 0] + values["c"] * values["V"]
    assert force.max() <= values["mu"] + 1e-6
    np.testing.assert_allclose(lacking[sticks, 1], force, atol=1e-6)


def test_a_gap_carries_no_force() -> None:
    _, states, lacking = motion("backlash", 30.0, w=1.3)
    values = values_of("backlash")
    distance = states[:, 0] - states[:, 1]
    clipped = np.clip(distance, -values["gap"], values["gap"])
    assert 0.05 < (np.abs(distance) < values["gap"]).mean() < 0.95
    np.testing.assert_allclose(lacking[:, 2], values["k"] * clipped, atol=1e-6)
    np.testing.assert_allclose(lacking[:, 3], -values["k"] * clipped, atol=1e-6)


def test_drag_is_quadratic_and_opposes() -> None:
    _, states, lacking = motion("quadratic_drag", 20.0, b=0.2)
    rate = states[:, 1]
    np.testing.assert_allclose(lacking[:, 1], -0.2 * rate * np.abs(rate), atol=1e-6)


def test_hysteresis_lags_and_is_bounded() -> None:
    _, states, lacking = motion("hysteresis", 30.0)
    values = values_of("hysteresis")
    assert np.abs(states[:, 2]).max() <= 1 / (values["beta"] + values["gamma"]) + 1e-6
    extra = values["part"] * values["k"] * (states[:, 0] - states[:, 2])
    np.testing.assert_allclose(lacking[:, 1], extra, atol=1e-9)
