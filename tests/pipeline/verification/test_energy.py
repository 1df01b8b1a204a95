"""The energy that a damped swing loses is known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.core.errors import InputError
from dashred.inference.fit.law import Law
from dashred.physics.system import System
from dashred.pipeline.verification.energy import energy_loss
from tests import laws

TEXT = """
system:
  title: a swing
  fields: {x: place, p: momentum}
  parameters: {k: 4.0}
  equations: {x: p, p: -k*x}
  start: {x: 1, p: 0}
  energy: ENERGY
  integrator: {method: rk4, dt: 0.01}
recording: {twin: a, sensors: 2, noise: 0, duration: 12, every: 0.1}
"""
TIMES = 0.02 * torch.arange(1001, dtype=torch.float64)
DAMPING, ERROR = -0.1, 0.004


def swing(folder: Path, energy: str = "p**2/2 + k*x**2/2") -> System:
    return laws.declared(folder, TEXT.replace("ENERGY", energy))


def damped(system: System, damping: float) -> Law:
    start = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
    found = torch.tensor([damping], dtype=torch.float64)
    covariance = torch.tensor([[ERROR**2]], dtype=torch.float64)
    candidate = laws.term(system, "p", "p")
    return Law((candidate,), found, covariance, start, 0.0, 1.0, torch.zeros(1))


def test_viscous_damping_loses_the_same_share_in_every_cycle(tmp_path: Path) -> None:
    system = swing(tmp_path)
    found = energy_loss(system, damped(system, DAMPING), TIMES, np.random.default_rng(0))
    assert found is not None and found["expression"] == "p**2/2 + k*x**2/2"
    # x'' = -4x - 0.1 x': the amplitude falls by exp(-0.05 T), T = 2π/√(4 - 0.05²).
    period = 2 * math.pi / math.sqrt(4 - (DAMPING / 2) ** 2)
    expected = 1 - math.exp(DAMPING * period)
    assert found["cycles"] == int(20 / period) - 1 or found["cycles"] == int(20 / period)
    for share in (found["first"], found["last"]):
        assert share["lost"] == pytest.approx(expected, rel=0.01)
        assert share["std"] == pytest.approx(ERROR * period * (1 - expected), rel=0.5)


def test_growth_is_a_negative_loss_and_no_law_loses_nothing(tmp_path: Path) -> None:
    system = swing(tmp_path)
    rng = np.random.default_rng(0)
    grown = energy_loss(system, damped(system, 0.1), TIMES, rng)
    assert grown is not None and grown["first"]["lost"] < -0.3
    start = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
    none = Law((), torch.zeros(0).double(), torch.zeros(0, 0).double(), start, 0.0, 1.0, start)
    kept = energy_loss(system, none, TIMES, rng)
    assert kept is not None and abs(kept["last"]["lost"]) < 1e-3 and kept["last"]["std"] == 0.0


def test_without_an_expression_or_a_cycle_nothing_is_said(tmp_path: Path) -> None:
    system = swing(tmp_path, "null")
    assert energy_loss(system, damped(system, DAMPING), TIMES, np.random.default_rng(0)) is None
    system = swing(tmp_path)
    few = TIMES[:100]
    assert energy_loss(system, damped(system, DAMPING), few, np.random.default_rng(0)) is None


def test_a_cycle_that_no_other_likely_law_has_is_not_reported(tmp_path: Path) -> None:
    system = swing(tmp_path)
    law = damped(system, DAMPING)
    # A damping this uncertain is an overdamped creep, or a blow-up, in every draw.
    vague = replace(law, covariance=torch.tensor([[1e6]], dtype=torch.float64))
    assert energy_loss(system, law, TIMES, np.random.default_rng(0)) is not None
    assert energy_loss(system, vague, TIMES, np.random.default_rng(0)) is None


@pytest.mark.parametrize(
    ("text", "problem"), [("p**2 + t", "cannot depend on t"), ("p**2 + y", "unknown name 'y'")]
)
def test_a_wrong_energy_is_refused_where_it_stands(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        swing(tmp_path, text)
