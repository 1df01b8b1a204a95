"""Recordings of systems whose simulators lack a term, for the methods that read the sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.integrate import solve_ivp

from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.peers.measured import Measured
from dashred.physics.terms.library import build_library
from tests.evaluation.foreign.invented import system_of

OSCILLATOR = {"x": "v", "v": "-2*x"}
LORENZ = {"x": "10*(y - x)", "y": "28*x - y", "z": "x*y - 8/3*z"}


def damped_oscillator(measured: str = "xv", noise: float = 0.02) -> Measured:
    """Return ``ẍ = −2x − 0.3ẋ``; the simulator lacks the damping."""
    return recording(
        OSCILLATOR,
        lambda t, s: [s[1], -2 * s[0] - 0.3 * s[1]],
        (1.0, 0.0),
        np.linspace(0, 12, 120),
        measured,
        noise,
        {"v": ["1", "x", "v", "x**2", "x*v", "x**3", "v**3", "abs(v)*v"]},
    )


def lorenz(measured: str = "xyz", noise: float = 0.02) -> Measured:
    """Return Lorenz's system over some seven orbits; the simulator lacks −xz in y'."""
    return recording(
        LORENZ,
        lambda t, s: [10 * (s[1] - s[0]), s[0] * (28 - s[2]) - s[1], s[0] * s[1] - 8 / 3 * s[2]],
        (-5.0, -7.0, 20.0),
        np.linspace(0, 5, 200),
        measured,
        noise,
        {"y": ["1", "x", "y", "z", "x*y", "x*z", "y*z", "x**3"]},
    )


def recording(
    equations: Mapping[str, str],
    truth: Callable[[float, Array], list[float]],
    start: Sequence[float],
    times: Array,
    measured: str,
    noise: float,
    library: Mapping[str, Sequence[str]],
) -> Measured:
    """Return the recording of a truth; the start is known to a tenth of the std."""
    solved = solve_ivp(truth, (0, times[-1]), start, t_eval=times, rtol=1e-10, atol=1e-10)
    states, rng = solved.y.T, np.random.default_rng(5)
    std, names = states.std(axis=0), list(equations)
    columns = [names.index(name) for name in measured]
    stated = states[0] + 0.1 * std * rng.standard_normal(len(names))
    system = system_of(
        {
            "title": "Test",
            "fields": dict.fromkeys(names, "state"),
            "equations": dict(equations),
            "start": dict(zip(names, stated.tolist(), strict=True)),
            "spread": dict(zip(names, (0.1 * std).tolist(), strict=True)),
            "integrator": {"method": "rk4", "dt": float(times[1]) / 4},
        }
    )
    errors = noise * std[columns] * rng.standard_normal((len(times), len(columns)))
    return Measured(
        system=system,
        library=build_library(system, library),
        times=times,
        readings=states[:, columns] + errors,
        columns=columns,
        noise=noise * std[columns],
        start=stated,
        spread=0.1 * std,
        seed=3,
    )
