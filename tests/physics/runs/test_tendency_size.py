"""Sizes of the right-hand sides of equations, also of one that is 0."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dashred.physics.runs.tendency_size import LEAST, tendency_size
from tests import laws

STILL = """
system:
  title: a reaction that the simulator does not know, and a clock
  fields: {a: reactant, c: clock, z: nothing}
  equations: {a: 0, c: 3, z: 0}
  start: {a: 2, c: 0, z: 0}
  spread: {a: 0.1, c: 0.1, z: 0.1}
  integrator: {method: rk4, dt: 0.1}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.25}
"""


@pytest.mark.parametrize("span", [10.0, 1e7])
def test_a_field_at_rest_has_the_size_of_a_change_by_itself(tmp_path: Path, span: float) -> None:
    system = laws.declared(tmp_path, STILL)
    times = torch.linspace(0, span, 21, dtype=torch.float64)
    states = torch.stack([torch.full_like(times, 2.0), 3 * times, torch.zeros_like(times)], dim=1)
    found = tendency_size(system, states, times)
    torch.testing.assert_close(found, torch.tensor([2 / span, 3.0, LEAST]).double())
    assert tendency_size(system, states, 0.0).tolist() == [LEAST, 3.0, LEAST]
