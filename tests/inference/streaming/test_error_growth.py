"""The growth of small errors: an exact rate, a stable orbit, and chaos."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from dashred.config import Source, build_config
from dashred.config.source_dict import source_from_dict
from dashred.inference.observer.march import March
from dashred.inference.streaming.error_growth import error_growth
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests.support import streams

LORENZ = {"x": "10*(y - x)", "y": "x*(28 - z) - y", "z": "x*y - 8/3*z"}


def system_of(equations: dict[str, str], dt: float) -> System:
    values: dict[str, Any] = {
        "system": {
            "title": "a system",
            "fields": {name: f"field {name}" for name in equations},
            "equations": equations,
            "start": dict.fromkeys(equations, 1),
            "integrator": {"method": "rk4", "dt": dt},
        },
        "recording": {"twin": "a", "sensors": 1, "noise": 0, "duration": 12, "every": 0.1},
    }
    source = source_from_dict(values, "dict")
    config = build_config(source, Source({}, {"": "overrides"}), name="system")
    return System(config.system, config.where)


def test_a_linear_system_has_the_rate_of_its_fastest_direction() -> None:
    system = system_of({"x": "0.3*x", "y": "-0.5*y"}, dt=0.05)
    climate = np.random.default_rng(0).standard_normal((50, 2))
    found = error_growth(March(system), climate, span=0.1, samples=120, seed=0)
    assert found == pytest.approx(0.3 * 12, rel=1e-3)


def test_a_stable_orbit_has_none() -> None:
    climate = streams.climate()[100:]
    assert abs(error_growth(March(streams.system()), climate, streams.EVERY, 120, seed=0)) < 0.7


def test_the_attractor_of_lorenz_has_its_exponent() -> None:
    system = system_of(LORENZ, dt=0.01)
    times = 0.1 * torch.arange(400, dtype=torch.float64)
    start = torch.tensor([[1.0, 1.0, 20.0]], dtype=torch.float64)
    climate = simulate(system, start, times)[0].numpy()[50:]
    found = error_growth(March(system), climate, span=0.1, samples=400, seed=0)
    # Its largest Lyapunov exponent is 0.906 (Sprott 2003).
    assert found / 40 == pytest.approx(0.906, rel=0.1)
