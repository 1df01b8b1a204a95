"""Perturbations may take longer steps than the estimate beside which they run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dashred.config import Source, build_config
from dashred.config.source_dict import source_from_dict
from dashred.inference.observer import perturbation_march
from dashred.inference.observer.estimate import Estimate
from dashred.inference.observer.march import March
from dashred.inference.observer.perturbation_march import PerturbationMarch, perturbation_step
from dashred.physics.system import System
from tests.inference.observer.test_both_gains import lorenz

Array = NDArray[np.float64]
SPAN, DT, POINTS, SHORT = 0.5, 0.05, 32, 16


def system_of(
    length: float, points: int, fields: dict[str, str], equations: dict[str, str]
) -> System:
    values: dict[str, Any] = {
        "system": {
            "title": "a periodic system",
            "axes": {"x": {"length": length, "points": points}},
            "fields": fields,
            "equations": equations,
            "start": dict.fromkeys(fields, "0"),
            "integrator": {"dt": DT},
        },
        "recording": {"twin": "a", "sensors": 4, "noise": 0, "duration": 5, "every": SPAN},
    }
    config = build_config(
        source_from_dict(values, "dict"), Source({}, {"": "overrides"}), name="waves"
    )
    return System(config.system, config.where)


def kuramoto_sivashinsky() -> System:
    return system_of(22, POINTS, {"u": "height"}, {"u": "-u*d(u, x) - d(u, x, 2) - d(u, x, 4)"})


def wave_equation() -> System:
    fields = {"u": "height", "v": "velocity"}
    return system_of(2 * np.pi, SHORT, fields, {"u": "v", "v": "d(u, x, 2)"})


@pytest.fixture(scope="module")
def march() -> March:
    return March(kuramoto_sivashinsky())


@pytest.fixture(scope="module")
def states(march: March) -> Array:
    """States of the attractor."""
    x = np.arange(POINTS) / POINTS
    phases = np.random.default_rng(0).uniform(size=(16, 2, 1))
    start = np.cos(2 * np.pi * (2 * x + phases[:, 0])) + np.cos(2 * np.pi * (3 * x + phases[:, 1]))
    return march(start, 0.0, 40.0)


def test_perturbations_take_longer_steps_and_the_estimate_does_not(
    march: March, states: Array
) -> None:
    step = perturbation_step(march, states, 0.0, SPAN)
    assert step is not None and step > 2 * DT
    estimates = [Estimate(states[i : i + 1], 0.1 * (states[4:8] - states[8:12])) for i in (0, 1)]
    found = PerturbationMarch(march, step)(estimates, 0.0, SPAN)
    for each, own in zip(estimates, found, strict=True):
        exact = march(each.states, 0.0, SPAN)
        np.testing.assert_allclose(own[0], exact[0], rtol=1e-12)
        grown, true = own[1:] - own[0], exact[1:] - exact[0]
        error = np.sqrt(np.mean((grown - true) ** 2) / np.mean(true**2))
        assert 1e-9 < error < perturbation_march.TOLERANCE


def test_steps_that_are_too_long_are_not_taken(
    march: March, states: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(perturbation_march, "TOLERANCE", 0.0)
    assert perturbation_step(march, states, 0.0, SPAN) is None


def test_steps_that_amplify_what_the_states_do_not_show_are_not_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Long waves do not show within some samples that a long step amplifies the shortest ones.
    waves, x = March(wave_equation()), 2 * np.pi * np.arange(SHORT) / SHORT
    amplitudes = np.random.default_rng(0).standard_normal((16, 2, 2))
    states = (amplitudes @ np.stack([np.sin(x), np.cos(x)])).reshape(16, -1)
    step = perturbation_step(waves, states, 0.0, SPAN)
    assert step is not None and step < SPAN
    monkeypatch.setattr(perturbation_march, "is_stable", lambda *_: True)
    assert perturbation_step(waves, states, 0.0, SPAN) == SPAN


def test_runs_that_blow_up_are_repeated_with_the_steps_of_the_simulator(
    march: March, states: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = PerturbationMarch(march, 5 * DT)
    estimate = Estimate(states[:1], states[1:4] - states[:1])
    exact, own = march(estimate.states, 0.0, SPAN), March.__call__

    def failing(self: March, states: Array, *rest: float | None) -> Array:
        longer = self.system.dt > DT
        return np.full_like(states, np.nan) if longer else own(self, states, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(March, "__call__", failing)
    np.testing.assert_array_equal(runs([estimate], 0.0, SPAN)[0], exact)


def test_without_perturbations_and_without_axes_the_steps_are_those_of_the_simulator(
    march: March, states: Array
) -> None:
    alone = Estimate(states[:1], states[:0])
    [found] = PerturbationMarch(march, 5 * DT)([alone], 0.0, SPAN)
    np.testing.assert_array_equal(found, march(states[:1], 0.0, SPAN))
    ode, at = March(lorenz()), np.random.default_rng(1).normal((0, 0, 25), 5, (16, 3))
    assert perturbation_step(ode, at, 0.0, SPAN) is None
    estimate = Estimate(at[:1], at[1:3] - at[:1])
    [found] = PerturbationMarch(ode, None)([estimate], 0.0, SPAN)
    np.testing.assert_array_equal(found, ode(estimate.states, 0.0, SPAN))
