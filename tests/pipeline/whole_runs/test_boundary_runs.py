"""Whole runs of a channel with an outflow and of a cylinder; the recordings are exact solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.special import j0, jn_zeros

import dashred

DECAY, NOISE = 0.3, 0.003
SMALL = {
    "simulation": {"members": 24, "held_out": 8},
    "shred": {"lags": 6, "epochs": 2, "modes": 8},
    "assimilation": {"epochs": 1},
    "surrogate": {"members": 16},
    "splits": {"sensors": {"validate": 1, "test": 1, "extra": 1}},
}
CHANNEL = {
    "title": "channel",
    "axes": {
        "x": {
            "length": 2,
            "points": 60,
            "ends": {"left": {"value": "1 + 0.5*sin(2*t)"}, "right": "outflow"},
        }
    },
    "fields": {"c": "concentration"},
    "equations": {"c": "-d(c, x)"},
    "start": {"c": "1 - 0.5*sin(2*x)"},
    "spread": {"c": 0.3, "length": 0.6},
    "integrator": {"dt": 0.05},
}
CYLINDER = {
    "title": "cylinder",
    "axes": {"r": {"length": 1, "points": 40, "ends": "fixed", "coordinates": "radial"}},
    "fields": {"c": "concentration"},
    "equations": {"c": "0.1*lap(c)"},
    "start": {"c": "1.2*(1 - r**2)"},
    "spread": {"c": 0.2, "length": 0.4},
    "integrator": {"dt": 0.05},
}


def in_channel(x: float, t: np.ndarray) -> np.ndarray:
    """Return ``c_t = -c_x - k c`` with the inflow ``1 + sin(2t)/2``."""
    return np.exp(-DECAY * x) * (1 + 0.5 * np.sin(2 * (t - x)))


def in_cylinder(r: float, t: np.ndarray) -> np.ndarray:
    """Return ``c_t = 0.1 (r c_r)_r/r - k c`` with c = 0 at r = 1, from two eigenfunctions."""
    first, second = jn_zeros(0, 2)
    slow = np.exp(-(0.1 * first**2 + DECAY) * t) * j0(first * r)
    return slow + 0.4 * np.exp(-(0.1 * second**2 + DECAY) * t) * j0(second * r)


@pytest.mark.parametrize(
    ("system", "solution", "library"),
    [
        (CHANNEL, in_channel, ["1", "c", "c**2", "d(c, x)", "d(c, x, 2)"]),
        (CYLINDER, in_cylinder, ["1", "c", "c**2", "d(c, r)", "lap(c)"]),
    ],
)
def test_a_missing_decay_is_found(
    system: dict[str, Any], solution: Any, library: list[str]
) -> None:
    times, [axis] = np.arange(41) * 0.1, system["axes"]
    places = np.linspace(0.1, 0.9, 7) * system["axes"][axis]["length"]
    rng = np.random.default_rng(2)
    frame = pd.DataFrame({"time": times})
    for i, place in enumerate(places):
        frame[f"s{i}"] = solution(place, times) + NOISE * rng.standard_normal(len(times))
    sensors = pd.DataFrame({"name": frame.columns[1:], "field": "c", axis: places})
    problem = dashred.Problem.from_dict(
        {"system": system, "library": {"c": library}, **SMALL}, recording=frame, sensors=sensors
    )
    findings = dict(problem.discover(seed=0).findings)
    assert findings["verdict"] == "missing-term"
    [term] = findings["terms"]
    assert term["term"] == "c"
    assert abs(term["coefficient"] + DECAY) < 0.02
