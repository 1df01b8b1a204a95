"""Laws are integrated by compiled code only if the simulator has compiled their own terms."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.inference.forward.law_block import LawBlock, WindowedTerms, restrict_to_window
from dashred.physics.window import box
from tests.waves import Waves

EDGES = [4.4, 1.8, math.log(0.3)]


def compile_simulator(waves: Waves) -> None:
    """Run the simulator once: the first run compiles it."""
    objective = waves.objective(waves.recorded(0.02, 1), 0.02)
    objective.values(torch.zeros((1, objective.modes), dtype=torch.float64))


def test_the_weights_are_those_of_a_run(waves: Waves) -> None:
    compile_simulator(waves)
    [plain] = waves.candidates(["u: u"])
    shape = box(waves.system.axes[0])
    windowed = WindowedTerms([plain], shape, torch.tensor(EDGES, dtype=torch.float64))
    block = LawBlock(waves.candidates(["v: 1"]), windowed)
    unknowns = torch.tensor([0.2, -0.3, 0.01, 0.0, 0.02], dtype=torch.float64)
    found = block.compiled_weights(waves.simulator, unknowns)
    assert found is not None
    torch.testing.assert_close(found, block.weights(waves.simulator, unknowns[None]))


@pytest.mark.parametrize(("coefficient", "compiled"), [(-0.3, False), (0.0, True)])
def test_terms_that_contain_a_window_are_not_compiled(
    waves: Waves, coefficient: float, compiled: bool
) -> None:
    """They have the key of the term everywhere; without a coefficient they do not matter."""
    compile_simulator(waves)
    window = box(waves.system.axes[0]).at(EDGES)
    block = LawBlock(restrict_to_window(waves.candidates(["u: u"]), window))
    unknowns = torch.tensor([coefficient], dtype=torch.float64)
    assert (block.compiled_weights(waves.simulator, unknowns) is not None) is compiled
