"""The step is chosen without the law; a law that needs a shorter one gets it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from dashred.config import load_config
from dashred.core.budget import Budget
from dashred.inference.segments.findings.segment_laws import law_from_segments
from dashred.pipeline.discovery.segments import segment_stage
from dashred.pipeline.discovery.segments.segment_stage import search_in_segments
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from dashred.pipeline.simulation.numerical_error import numerical_error

TEXT = """
system:
  title: oscillator
  fields: {x: place, v: velocity}
  equations: {x: v, v: -x - 0.1*v}
  start: {x: 3, v: 0}
  spread: {x: 0.5, v: 0.5}
  integrator: {dt: null}
library: {v: ["1", x, v, x**3, v**3, x*v]}
recording: {path: recording.csv}
"""
CUBIC, NOISE = -10.0, 0.002


@pytest.mark.slow
def test_a_law_faster_than_the_simulation_is_searched_with_a_shorter_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = np.arange(0, 20, 0.4)
    found = solve_ivp(
        lambda t, u: [u[1], -u[0] - 0.1 * u[1] + CUBIC * u[1] ** 3],
        (0, 20),
        [3.0, 0.0],
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
    ).y
    noisy = found + NOISE * np.random.default_rng(1).standard_normal(found.shape)
    table = pd.DataFrame({"time": times, "x": noisy[0], "v": noisy[1]})
    table.to_csv(tmp_path / "recording.csv", index=False)
    path = tmp_path / "oscillator.yaml"
    path.write_text(TEXT)
    chosen = build_problem(load_config([f"conf={path}"], entry="train"))
    problem, search = search_in_segments(chosen, simulate_nominal(chosen, {}), {})
    assert search is not None
    assert problem.system.dt < chosen.system.dt
    assert "which the law needs" in problem.clock
    law = law_from_segments(search, search.best)
    [term] = law.candidates
    assert str(term) == "v: v**3"
    assert abs(float(law.coefficients[0]) - CUBIC) < 0.02
    error = numerical_error(problem, law, problem.fit_noise_std())
    assert error is not None and error <= 1

    # Without time for a second search, the findings say that the law needs a shorter step.
    late = replace(chosen, budget=Budget.begin(1e-9))
    monkeypatch.setattr(segment_stage, "_search_about_parameters", lambda *_: (late, search))
    same, unchanged = search_in_segments(late, simulate_nominal(chosen, {}), {})
    assert same is late and unchanged is search
    assert any("that the law needs" in what for what in late.budget.not_tried)
