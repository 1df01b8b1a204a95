"""The derivative takes larger time steps than the simulator if they are stable."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import LinearStart
from dashred.physics.forcing_basis import ForcingBasis
from tests.waves import TIMES, Waves

STEP, LONGER = 0.01, 0.25


def far_off(waves: Waves, tangent_dt: float) -> ForwardModel:
    """Return a forward model in a stiff region, with the time step of its derivative."""
    candidates = waves.candidates(["u: u", "v: v**2"])
    shape = (len(waves.system.fields), *waves.system.grid.shape)
    modes = torch.eye(2, dtype=torch.float64).reshape(2, 2, 1).expand(2, *shape)
    start = LinearStart(torch.full(shape, 12.0, dtype=torch.float64), modes)
    part = CandidateSimulator(waves.system.with_step(STEP), tangent_dt, candidates)
    plain = waves.forward_model(LawBlock(candidates))
    return replace(plain, simulator=Simulator([part]), start=EpisodeStarts((start,)))


def test_an_unstable_derivative_takes_the_steps_of_the_simulator(waves: Waves) -> None:
    forward_model, exact = far_off(waves, LONGER), far_off(waves, STEP)
    z, xi = torch.zeros(2).double(), torch.zeros(2).double()
    assert not torch.isfinite(forward_model._columns(z, xi)).all()
    found, expected = forward_model.linearise(z, xi), exact.linearise(z, xi)
    torch.testing.assert_close(found.by_start, expected.by_start)
    torch.testing.assert_close(found.by_coefficients, expected.by_coefficients)
    assert torch.isfinite(found.readings).all()


@pytest.mark.parametrize("block_size", [1, 300, 10**9])
def test_blocks_of_samples_do_not_change_the_jacobian(
    waves: Waves, block_size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    forward_model = far_off(waves, STEP)
    z, xi = torch.zeros(2).double(), torch.zeros(2).double()
    expected = forward_model._columns(z, xi)
    monkeypatch.setattr("dashred.inference.forward.simulator.BLOCK_SIZE", block_size)
    torch.testing.assert_close(forward_model._columns(z, xi), expected, rtol=1e-8, atol=1e-10)
    assert expected.shape == (len(TIMES), len(waves.operator.sensors), 4)


def test_an_unstable_derivative_with_a_free_forcing(waves: Waves) -> None:
    forcing_basis = ForcingBasis.over(waves.system, TIMES, 3, 4)
    block = ForcingBlock(forcing_basis, waves.size)
    z, xi = torch.zeros(2).double(), torch.zeros(2 + block.count).double()
    found, expected = (
        replace(far_off(waves, step), forcing=block).linearise(z, xi) for step in (LONGER, STEP)
    )
    torch.testing.assert_close(found.by_coefficients, expected.by_coefficients)
