"""Hidden states are found where no law of the library explains the recording, and only there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.inference.hidden_states.search import search_hidden_states
from dashred.inference.results.hidden_state import hidden_state
from dashred.inference.segments.findings.segment_laws import law_from_segments
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.discovery.segments.library_choice import search_libraries
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal

# A mug whose wall, at room temperature, takes heat from the water.
MUG = """
system:
  title: mug
  fields: {T: temperature of the water}
  parameters: {k: 0.025, Ta: 22}
  equations: {T: -k*(T - Ta)}
  start: {T: 88}
  spread: {T: 5}
  units: {T: degC, t: min}
library: {T: ["1", T, T**2]}
splits: {sensors: {validate: 0, test: 0, extra: 0}}
recording: {path: recording.csv}
"""
GAIN, TAU, TIMES = 0.2, 3.4, np.linspace(0, 60, 241)


def water(gain: float, first: float = 90.0, wall: float = 22.0) -> np.ndarray:
    """Return the temperature of the water, with a wall of this gain; exact."""
    rates = np.array([[-0.025 - gain, gain], [1 / TAU, -1 / TAU]])
    values, vectors = np.linalg.eig(rates)
    shares = np.linalg.solve(vectors, np.array([first - 22, wall - 22]))
    return 22 + (vectors[0] * shares) @ np.exp(np.outer(values, TIMES))


def searched(folder: Path, truth: np.ndarray) -> tuple[Problem, SegmentSearch]:
    noise = 0.1 * np.random.default_rng(3).standard_normal(len(TIMES))
    table = np.column_stack([TIMES, truth + noise])
    np.savetxt(folder / "recording.csv", table, delimiter=",", header="time,T", comments="")
    (folder / "mug.yaml").write_text(MUG)
    problem = build_problem(load_config([f"conf={folder / 'mug.yaml'}"], entry="test"))
    problem, found = search_libraries(problem, simulate_nominal(problem, {}))
    assert found is not None
    return problem, found


def test_the_wall_of_a_mug_is_a_hidden_state(tmp_path: Path) -> None:
    problem, found = searched(tmp_path, water(GAIN))
    law = law_from_segments(found, found.best)
    told = hidden_state(problem.system, law, problem.hidden)
    assert told is not None
    assert (told["equation"], told["term"], told["follows"]) == ("T", "z - T", "T")
    assert told["time_constant_ci95"][0] < TAU < told["time_constant_ci95"][1]
    assert told["gain_ci95"][0] < GAIN < told["gain_ci95"][1]
    assert told["time_constant_std"] < 0.1 * TAU and told["gain_std"] < 0.1 * GAIN
    assert told["start"] == pytest.approx(22, abs=5)
    assert (told["time_unit"], told["gain_unit"]) == ("min", "1/min")
    # The laws without it are worse, and the simulator with it is that without it.
    without = min(each.score for each in found.laws if found.problem.count - 1 not in each.members)
    assert found.best.score < without - 10
    times = torch.from_numpy(TIMES)
    start = torch.tensor([[88.0, 60.0]], dtype=torch.float64)
    alone = simulate(problem.system, start, times)[0, :, 0]
    assert alone.numpy() == pytest.approx(22 + 66 * np.exp(-0.025 * TIMES), abs=1e-3)


def test_a_term_of_the_library_is_no_hidden_state(tmp_path: Path) -> None:
    # With ε = T - 22, the exact solution of ε' = -kε - cε² is known.
    decay = np.exp(-0.025 * TIMES)
    cooled = 22 + 68 * decay / (1 + 68 * 0.002 / 0.025 * (1 - decay))
    problem, found = searched(tmp_path, cooled)
    assert problem.hidden is None
    assert search_hidden_states(found, problem.split.fit.sensors, ["T"]) is None


def test_plain_cooling_is_no_hidden_state(tmp_path: Path) -> None:
    problem, found = searched(tmp_path, water(0.0))
    assert problem.hidden is None and not found.best.members
    assert search_hidden_states(found, problem.split.fit.sensors, ["T"]) is None
