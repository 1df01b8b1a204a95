"""The structures that bundled systems claim hold on their own simulations."""

from __future__ import annotations

import pytest
import torch

from dashred.config import load_config
from dashred.physics.prior import nominal_start
from dashred.physics.simulate import simulate
from dashred.physics.system import System
from dashred.stages.structure import check_structure


@pytest.mark.parametrize("name", ["mass_spring", "wave"])
def test_a_bundled_structure_makes_the_equations(name: str) -> None:
    config = load_config([f"conf={name}"], entry="test")
    system = System(config.system, config.where)
    assert system.config.structure is not None
    times = torch.linspace(0, 3, 16, dtype=torch.float64)
    check_structure(system, simulate(system, nominal_start(system), times)[0])
