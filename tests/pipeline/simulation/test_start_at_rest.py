"""A simulator of fields whose nominal start is uniform, and stays so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from dashred.pipeline.simulation.nudging import stands_still
from tests.pipeline.simulation.conftest import RECORDING, SHORT_RUN
from tests.ring_recording import write_ring_recording

SYSTEM = """
system:
  title: a tracer in a ring
  axes: {x: {length: 10, points: 32}}
  fields: {u: concentration}
  equations: {u: 0.2*lap(u)MISSING}
  start: {u: UNIFORM}
  spread: {u: 1}
  integrator: {dt: 0.02}
"""
TIMES = torch.linspace(0, 6, 61, dtype=torch.float64)


@pytest.fixture(params=["0", "2"])
def at_rest(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """The configuration of a uniform start, beside a recording of a wave that is carried along."""
    system = SYSTEM.replace("UNIFORM", request.param)
    complete = system.replace("MISSING", " - 0.7*d(u, x)")
    write_ring_recording(tmp_path, complete, (float(request.param), 0.8), TIMES, 10, 0.01)
    (tmp_path / "case.yaml").write_text(system.replace("MISSING", "") + RECORDING + SHORT_RUN)
    return tmp_path / "case.yaml"


def test_the_corrected_run_gives_the_scales(at_rest: Path) -> None:
    problem = build_problem(load_config([f"conf={at_rest}"], entry="test"))
    nominal = simulate_nominal(problem, {})
    assert stands_still(problem, nominal.states)
    [reference] = nominal.references
    fit = problem.split.fit
    read = problem.operator(fit)(reference[: len(fit.values)]).numpy()
    assert np.std(read) > 0.5 * np.std(fit.values)


def test_the_law_is_found(at_rest: Path, train) -> None:
    ended = train(f"conf={at_rest}", f"recording.path={at_rest.parent / 'recording.csv'}")
    assert ended.code == 0, ended.err
    findings = json.loads(ended.read("findings.json"))
    assert findings["verdict"] == "missing-term"
    [term] = findings["terms"]
    assert (term["equation"], term["term"]) == ("u", "d(u, x)")
    assert term["coefficient"] == pytest.approx(-0.7, rel=0.02)
