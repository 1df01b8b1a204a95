"""A simulator in which a field without a sensor, or one beside it, grows without bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from dashred.config import load_config
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensembles import simulate_nudged_ensemble
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from tests.pipeline.simulation.conftest import SHORT_RUN

SETTINGS = (
    """
recording: {path: recording.csv}
splits: {sensors: {validate: 0, test: 0, extra: 0}}
simulation: {members: 12, held_out: 4, terms: 1}"""
    + SHORT_RUN
)
# Convection, without the term 30 y in the equation of x: y then grows as exp(18 t).
CONVECTION = """
system:
  title: convection
  fields: {x: flow, y: temperature, z: stratification}
  equations: {x: -30*x, y: 18*y - x*z, z: -5*z + x*y}
  start: {x: -5, y: -7, z: 8}
  spread: {x: 1, y: 1, z: 1}
  integrator: {method: rk4, dt: 0.003}
"""
# A neuron, without the cubic term in the equation of x: x then blows up from sample to sample.
NEURON = """
system:
  title: neuron
  fields: {x: potential, y: recovery, z: adaptation}
  equations:
    x: -x + 33.3*y + 33.3*z + 33.3*x**2
    y: z - 0.49*x**3
    z: 0.04025 - 1.25*x - 1.25*z
  start: {x: 0.09, y: 0.01, z: 0.014}
  spread: {x: 0.03, y: 0.015, z: 0.012}
  integrator: {method: rk4, dt: 0.0055}
"""


def convection(_: float, u: np.ndarray) -> list[float]:
    x, y, z = u
    return [-30 * x + 30 * y, 18 * y - x * z, -5 * z + x * y]


def neuron(_: float, u: np.ndarray) -> list[float]:
    x, y, z = u
    rate = -x + 33.3 * (y + z + x**2 - 0.49 * x**3)
    return [rate, z - 0.49 * x**3, 0.04025 - 1.25 * (x + z)]


def recorded(
    folder: Path,
    system: str,
    tendency: Callable[[float, np.ndarray], list[float]],
    start: list[float],
    times: np.ndarray,
    read: Sequence[str],
) -> Problem:
    exact = solve_ivp(tendency, (0, times[-1]), start, "Radau", times, rtol=1e-8, atol=1e-10).y.T
    rng = np.random.default_rng(3)
    readings = exact + 0.02 * exact.std(axis=0) * rng.standard_normal(exact.shape)
    columns = ["xyz".index(name) for name in read]
    rows = np.column_stack([times, readings[:, columns]])
    header = ",".join(["time", *read])
    np.savetxt(folder / "recording.csv", rows, delimiter=",", header=header, comments="")
    (folder / "case.yaml").write_text(system + SETTINGS)
    return build_problem(load_config([f"conf={folder / 'case.yaml'}"], entry="test"))


def test_a_run_whose_unread_field_grows_without_bounds_is_restarted(tmp_path: Path) -> None:
    times = np.linspace(0, 9, 313)
    problem = recorded(tmp_path, CONVECTION, convection, [-5.5, -7.3, 8.4], times, "xz")
    nominal = simulate_nominal(problem, {})
    assert float(nominal.states[:, 1].abs().max()) > 1e30
    assert nominal.restarted
    [reference] = nominal.references
    assert float(reference.abs().max()) < 1e3


def test_nudged_members_stay_finite_beside_an_unread_field(tmp_path: Path) -> None:
    times = np.linspace(0, 17, 310)
    problem = recorded(tmp_path, NEURON, neuron, [0.1, 0.0, 0.01], times, "xy")
    states = (
        simulate_nudged_ensemble(problem, simulate_nominal(problem, {}), {}).states[:, :].numpy()
    )
    assert np.isfinite(states).all()
    assert np.abs(states[..., 2]).max() < 100 * np.abs(problem.split.fit.values).max()
