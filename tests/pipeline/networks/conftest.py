"""A small problem with the runs of its simulator, for the networks alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dashred.config import load_config
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation_runs import SimulationRuns, simulate
from tests.ring_recording import write_ring_recording

SYSTEM = """\
system:
  title: Burgers
  axes: {x: {length: 2*pi, points: 32}}
  fields: {u: velocity}
  parameters: {nu: 0.2}
  equations: {u: "-d(u**2/2, x) + nu*lap(u)MISSING"}
  start: {u: 1 + 0.5*cos(x)}
  spread: {u: 10%, length: 1.0}
  integrator: {dt: 0.05}
"""
SETTINGS = """
recording: {path: recording.csv, sensors: sensors.csv}
splits: {sensors: {validate: 1, test: 1, extra: 1}}
library: {u: [u, u**2, "d(u, x)"]}
simulation: {members: 24, held_out: 6, terms: 1}
shred: {lags: 5, latent: 8, decoder: [16], modes: 8, epochs: 4, steps: 7, batch: 8, rate: 2e-2}
assimilation: {epochs: 4, width: 8, batch: 16, rate: 2e-2, gain: 0}
latent_sindy: {steps: [1, 2], bootstraps: 3, begins: 3}
threads: 1
budget: 1e5
"""
Configured = Callable[..., SimulationRuns]


@pytest.fixture(scope="session")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration of a system whose recording has one more term."""
    folder = tmp_path_factory.mktemp("networks")
    times = 0.1 * torch.arange(41, dtype=torch.float64)
    lawful = SYSTEM.replace("MISSING", " - 0.1*u")
    write_ring_recording(folder, lawful, (1.0, 0.5), times, 8, 0.01)
    path = folder / "case.yaml"
    path.write_text(SYSTEM.replace("MISSING", "") + SETTINGS, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def simulated(case: Path) -> SimulationRuns:
    """The runs of the simulator."""
    return simulate(build_problem(load_config([f"conf={case}"], entry="test")), {})


@pytest.fixture(scope="session")
def configured(case: Path, simulated: SimulationRuns) -> Configured:
    """``configured(*words)``: the same runs, with other settings of the networks."""

    def runs(*words: str) -> SimulationRuns:
        config = load_config([f"conf={case}", *words], entry="test")
        return replace(simulated, problem=replace(simulated.problem, config=config))

    return runs
