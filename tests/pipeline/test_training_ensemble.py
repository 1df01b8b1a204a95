"""SHRED is trained on the states of a law where the budget leaves no time for simulations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from dashred.config import load_config
from dashred.core.budget import Budget
from dashred.inference.segments.findings.segment_laws import states_by_sample
from dashred.pipeline.discovery.segments.segment_stage import search_in_segments
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from dashred.pipeline.simulation_runs import _training_ensemble

TEXT = """
system:
  title: decay
  fields: {x: amount}
  equations: {x: -x}
  start: {x: 2}
  spread: {x: 0.1}
  integrator: {dt: 0.05}
library: {x: ["1", x]}
recording: {path: recording.csv}
"""


def test_a_law_that_is_known_does_not_end_in_an_error_without_time(tmp_path: Path) -> None:
    times = np.arange(0, 4, 0.1)
    noise = 0.005 * np.random.default_rng(1).standard_normal(len(times))
    table = pd.DataFrame({"time": times, "x": 0.5 + 1.5 * np.exp(-times) + noise})
    table.to_csv(tmp_path / "recording.csv", index=False)
    path = tmp_path / "decay.yaml"
    path.write_text(TEXT)
    problem = build_problem(load_config([f"conf={path}"], entry="train"))
    nominal = simulate_nominal(problem, {})
    problem, search = search_in_segments(problem, nominal, {})
    assert search is not None
    spent = Budget.begin(1e-9)
    ensemble = _training_ensemble(replace(problem, budget=spent), nominal, search, {})
    [states] = states_by_sample(search, search.best)
    assert torch.equal(ensemble.states[0].squeeze(), states.squeeze())
    assert spent.not_tried == [
        "training SHRED on the simulator without the law",
        "training SHRED on any simulation",
    ]
