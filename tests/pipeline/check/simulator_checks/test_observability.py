"""Observability of an initial state, against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.config import load_config
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.check.context import CheckContext, build_check_context
from dashred.pipeline.check.simulator_checks import observability, simulator
from dashred.pipeline.check.simulator_checks.observability import (
    linearised_observations,
    observability_remarks,
)
from dashred.pipeline.check.simulator_checks.simulator import run_nominal

DECAY = """\
system:
  title: Decay
  fields: {{u: amount}}
  equations: {{u: -0.3*u}}
  start: {{u: 1}}
  spread: {{u: 0.5}}
  integrator: {{method: {method}, dt: 0.02}}
library: {{u: [u, u**2]}}
recording: {{path: decay.csv, sensors: table.csv}}
"""
SIGMA, SPREAD, STEP = 0.05, 0.5, 0.1


def decay(tmp_path: Path, method: str = "rk4") -> CheckContext:
    """Return the check of a decay from t = 0 to 10."""
    t = STEP * np.arange(101)
    rows = [f"{now:.2f},{np.exp(-0.3 * now):.6f}" for now in t]
    (tmp_path / "decay.csv").write_text("\n".join(["time,s", *rows]) + "\n")
    (tmp_path / "table.csv").write_text(f"name,field,std\ns,u,{SIGMA}\n")
    (tmp_path / "decay.yaml").write_text(DECAY.format(method=method))
    return build_check_context(load_config([f"conf={tmp_path / 'decay.yaml'}"], entry="check"))


def test_the_time_of_a_compilation_does_not_shorten_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    durations = iter([60.0, 1e-3, 1e-3])

    def timed(system: System, start: Tensor, times: Tensor) -> tuple[Tensor, float]:
        return simulate(system, start, times), next(durations)

    monkeypatch.setattr(simulator, "timed_simulation", timed)
    context = decay(tmp_path)
    assert len(run_nominal(context).times) == len(context.times)


def test_the_part_that_the_check_had_time_for_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(observability, "SECONDS", 0.0)
    context = decay(tmp_path)
    nominal = run_nominal(context)
    observed = linearised_observations(context, nominal)
    said = next(observability_remarks(context, observed)).text
    assert f"(the first 3 of {len(context.times)} samples)" in said


@pytest.mark.parametrize("method", ["rk4", "dopri5"])
def test_what_stays_unknown_of_a_decay_is_the_kalman_smoother_s(
    tmp_path: Path, method: str
) -> None:
    """``1/P = 1/s² + Σ e^{-2at}/σ²`` over the fit and validation samples: 80 % of the record."""
    context = decay(tmp_path, method)
    observed = linearised_observations(context, run_nominal(context))
    assert observed is not None
    sampled = STEP * np.arange(observed.samples)
    information = 1 / SPREAD**2 + np.exp(-0.6 * sampled).sum() / SIGMA**2
    expected = 1 / np.sqrt(information) / SPREAD
    assert observed.samples > 20
    torch.testing.assert_close(
        observed.posterior_ratio(), torch.tensor([expected], dtype=torch.float64), rtol=1e-4, atol=0
    )
