"""The whole law of a system, where the simulator knows none of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashred.config import load_config
from dashred.pipeline.discovery.segments.segment_search import search_library
from dashred.pipeline.discovery.segments.segment_stage import with_few_terms
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal

QUADRATIC = "[1, x, y, z, x**2, x*y, x*z, y**2, y*z, z**2]"
TEXT = f"""
system:
  title: convection without its equations
  fields: {{x: flow, y: temperature across, z: temperature up}}
  equations: {{x: 0, y: 0, z: 0}}
  start: {{x: -8, y: 8, z: 27}}
  spread: {{x: 2, y: 2, z: 2}}
  integrator: {{method: rk4, dt: 0.01}}
library: {{x: {QUADRATIC}, y: {QUADRATIC}, z: {QUADRATIC}}}
recording: {{path: readings.csv}}
splits: {{sensors: {{validate: 0, test: 0, extra: 0}}}}
"""
LORENZ = {
    **{"x: x": -10.0, "x: y": 10.0, "y: x": 28.0, "y: y": -1.0, "y: x*z": -1.0},
    **{"z: z": -8 / 3, "z: x*y": 1.0},
}


def recorded(path: Path, noise: float) -> None:
    """Write readings of all three states with noise of that standard deviation."""
    times = np.linspace(0, 6, 401)
    exact = solve_ivp(
        lambda t, u: [10 * (u[1] - u[0]), u[0] * (28 - u[2]) - u[1], u[0] * u[1] - 8 / 3 * u[2]],
        (0, 6),
        [-8.0, 8.0, 27.0],
        t_eval=times,
        rtol=1e-10,
        atol=1e-10,
    ).y
    read = exact + np.random.default_rng(5).normal(0, noise, exact.shape)
    table = np.column_stack([times, *read])
    np.savetxt(path, table, delimiter=",", header="time,x,y,z", comments="")


@pytest.mark.parametrize(("noise", "tolerance"), [(0.5, 0.1), (1.5, 0.3)])
def test_no_law_of_a_few_terms_forecasts_the_record_and_one_of_seven_does(
    tmp_path: Path, noise: float, tolerance: float
) -> None:
    recorded(tmp_path / "readings.csv", noise)
    (tmp_path / "case.yaml").write_text(TEXT)
    problem = build_problem(load_config([f"conf={tmp_path / 'case.yaml'}"], entry="test"))
    found = search_library(problem, simulate_nominal(problem, {}))
    assert found is not None
    told = with_few_terms(found)
    candidates, values = told.terms(told.best)
    law = {str(candidate): value for candidate, value in zip(candidates, values, strict=True)}
    assert law == pytest.approx(LORENZ, rel=tolerance)
