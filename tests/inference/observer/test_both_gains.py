"""The gain follows the state of a chaotic system, and is the mean one in a linear system."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dashred.config import Source, build_config
from dashred.config.source_dict import source_from_dict
from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.observer import both_gains
from dashred.inference.observer.estimate import PERTURBATIONS
from dashred.inference.observer.march import March
from dashred.inference.observer.observe import observe
from dashred.inference.observer.observed_record import ObservedRecord
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests.inference.observer.test_observe import LINEAR
from tests.inference.observer.test_observe import record as oscillator_record

Array = NDArray[np.float64]

# Errors grow by a tenth between samples in the mean, and twofold at times.
EVERY, SIGMA, MEMBERS, SAMPLES = 0.1, 0.5, 200, 80


def lorenz() -> System:
    values: dict[str, Any] = {
        "system": {
            "title": "the Lorenz system",
            "fields": {"x": "x", "y": "y", "z": "z"},
            "equations": {"x": "10*(y - x)", "y": "x*(28 - z) - y", "z": "x*y - 8/3*z"},
            "start": {"x": 1, "y": 1, "z": 20},
            "integrator": {"method": "rk4", "dt": 0.01},
        },
        "recording": {"twin": "a", "sensors": 1, "noise": 0, "duration": 5, "every": EVERY},
    }
    source = source_from_dict(values, "dict")
    config = build_config(source, Source({}, {"": "overrides"}), name="lorenz")
    return System(config.system, config.where)


def lorenz_record(seed: int) -> tuple[ObservedRecord, Array]:
    """Return a recording of x, with simulations from the attractor, and its state."""
    system, rng = lorenz(), np.random.default_rng(seed)
    starts = torch.from_numpy(rng.normal((0, 0, 25), 5, (MEMBERS + 1, 3)))
    spin_up = torch.tensor([0.0, 10.0], dtype=torch.float64)
    starts = simulate(system, starts, spin_up)[:, -1]
    times = EVERY * torch.arange(SAMPLES, dtype=torch.float64)
    paths = simulate(system, starts, times)
    state = paths[-1].numpy()
    found = ObservedRecord(
        March(system),
        lambda sample: paths[:-1, sample].numpy(),
        times.numpy(),
        state[:, :1] + SIGMA * rng.standard_normal((SAMPLES, 1)),
        np.array([SIGMA]),
        ObservationOperator((Sensor("x", "x"),), system),
        np.ones((1, 4)),
    )
    return found, state


def error(states: Array, truth: Array) -> float:
    """Return the RMSE after the beginning."""
    return float(np.sqrt(np.mean((states - truth)[20:] ** 2)))


def test_in_a_chaotic_system_the_gain_follows_the_state(monkeypatch: pytest.MonkeyPatch) -> None:
    records = [lorenz_record(seed) for seed in range(4)]
    found = [observe([given], (0,))[0] for given, _ in records]
    assert {each.perturbations for each in found} == {PERTURBATIONS}
    errors = [error(each.states, state) for each, (_, state) in zip(found, records, strict=True)]
    monkeypatch.setattr(both_gains, "MARGIN", np.inf)
    by_mean = [observe([given], (0,))[0] for given, _ in records]
    assert {each.perturbations for each in by_mean} == {0}
    others = [error(each.states, state) for each, (_, state) in zip(by_mean, records, strict=True)]
    assert np.median(errors) < 0.8 * np.median(others)


def test_its_spread_is_the_size_of_the_error() -> None:
    scores = []
    for seed in range(4):
        given, state = lorenz_record(seed)
        [found] = observe([given], (0,))
        scores.append(((found.states - state) / found.spread)[20:])
    within = np.mean(np.abs(scores) < 1.645)
    assert 0.8 < within < 0.98


def test_in_a_linear_system_the_gain_is_the_mean_one() -> None:
    given, _ = oscillator_record(LINEAR, members=200)
    assert observe([given], (0,))[0].perturbations == 0
