"""A linear system, recorded with and without damping that its simulator lacks."""

from __future__ import annotations

import pytest

from dashred.config import load_config
from dashred.evaluation.twins import record_command
from dashred.physics.runs.ensemble import Ensemble
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensembles import simulate_ensemble
from dashred.pipeline.simulation.nominal_run import NominalRun, simulate_nominal

SWING = """
system:
  title: mass on a spring
  fields: {q: place, p: momentum}
  parameters: {k: 3.0}
  equations: {q: p, p: -k*q}
  start: {q: 1.0, p: 0.0}
  spread: {q: 0.3, p: 0.3}
  integrator: {method: rk4, dt: 0.02}
library: {p: [1, q, p, q**2, q*p, p**2, q**3, p**3]}
recording: {twin: a, sensors: 1, noise: 0.02, duration: 12, every: 0.1, reads: [q]}
splits: {sensors: {validate: 0, test: 0}}
"""
HIDDEN = "a:\n  terms: [{equation: p, term: p, coefficient: -0.1}]\n'null':\n  terms: []\n"


@pytest.fixture(scope="module")
def swing(
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, tuple[Problem, NominalRun, Ensemble]]:
    """Return a linear system whose recording hides damping, and one that hides nothing."""
    folder = tmp_path_factory.mktemp("swing")
    path = folder / "swing.yaml"
    path.write_text(SWING)
    (folder / "twins").mkdir()
    (folder / "twins" / "swing.yaml").write_text(HIDDEN)
    found = {}
    for twin in ("a", "null"):
        out = folder / twin
        assert record_command.main([f"conf={path}", f"recording.twin={twin}", f"output={out}"]) == 0
        reads = [f"conf={path}", f"recording.path={out / 'recording.nc'}"]
        config = load_config([*reads, "simulation.discrepancy=false"], entry="test")
        problem = build_problem(config)
        nominal = simulate_nominal(problem, {})
        found[twin] = problem, nominal, simulate_ensemble(problem, nominal, {})
    return found
