"""Steps of the simulator between the samples of episodes, with a law."""

from __future__ import annotations

import pytest
import torch

from dashred.models.dynamics import sampled_dynamics
from dashred.models.dynamics.sampled_dynamics import EpisodeSteps, SampledDynamics
from dashred.physics.solvers.sample_step import SampleStep
from dashred.physics.solvers.simulate import simulate
from dashred.physics.terms.library import resolve
from tests import ring

COUNTS = (5, 4)


@pytest.fixture
def system(tmp_path):
    return ring.linear_system(tmp_path)


@pytest.fixture
def dynamics(system) -> SampledDynamics:
    step = SampleStep(system, 0.1)
    episodes = [EpisodeSteps(step, ring.TIMES[:5], 0), EpisodeSteps(step, ring.TIMES[:4], 5)]
    terms = [(term,) for term in resolve(system, ring.library(system))]
    scales = torch.linspace(1, 2, len(terms)).double()
    return SampledDynamics(episodes, terms, scales, torch.tensor([2.0]), 32)


@pytest.mark.parametrize("samples", [1, 3, 100])
def test_every_step_is_in_one_block_and_none_leads_into_another_episode(
    dynamics, samples, monkeypatch
):
    monkeypatch.setattr(dynamics, "at_once", samples)
    steps = [row for b in dynamics.blocks() for row in range(b.rows.start, b.rows.stop - 1)]
    assert steps == [0, 1, 2, 3, 5, 6, 7]
    assert [b.rows.stop for b in dynamics.blocks() if b.is_last] == [5, 9]
    assert all(len(b.begins) == len(b.durations) <= samples for b in dynamics.blocks())


def test_a_large_state_is_stepped_in_smaller_blocks(system, monkeypatch):
    monkeypatch.setattr(sampled_dynamics, "VALUES_AT_ONCE", 64)
    step = SampleStep(system, 0.1)
    episodes = [EpisodeSteps(step, ring.TIMES[:5], 0)]
    found = SampledDynamics(episodes, (), torch.zeros(0), torch.ones(1), 32)
    assert found.at_once == 2


def test_a_coefficient_may_multiply_several_terms(system, dynamics):
    states, [one, other, *_] = ring.starts(system, 4, 3), dynamics.terms
    both = SampledDynamics(
        dynamics.episodes, [(*one, *other)], torch.ones(1), dynamics.spread.float(), 32
    )
    both.set_law(torch.tensor([-0.1], dtype=torch.float64))
    law = torch.zeros(len(dynamics.terms), dtype=torch.float64)
    law[:2] = -0.1
    dynamics.set_law(law)
    found = [each.advance(next(each.blocks()), states) for each in (both, dynamics)]
    torch.testing.assert_close(found[0], found[1], rtol=1e-12, atol=1e-12)


def test_the_forecast_is_that_of_the_system_with_the_law(system, dynamics):
    library = ring.library(system)
    law = torch.zeros(len(library), dtype=torch.float64)
    law[1], law[2] = -0.2, 0.05
    dynamics.set_law(law)
    torch.testing.assert_close(dynamics.coefficients, law)
    assert dynamics.support.sum() == 2
    states = ring.starts(system, 4, 3)
    block = next(dynamics.blocks())
    found = dynamics.advance(block, states)
    lawful = system.with_terms([(library[1], -0.2), (library[2], 0.05)])
    expected = simulate(lawful, states, ring.TIMES[:2])[:, -1]
    torch.testing.assert_close(found, expected, rtol=1e-6, atol=1e-8)
    found.sum().backward()
    assert dynamics.law.grad is not None
    assert set(dynamics.law.grad.nonzero()[:, 0].tolist()) == {1, 2}


def test_fields_are_compared_in_units_of_their_std(dynamics):
    assert torch.equal(dynamics.scaled(torch.full((3, 1, 32), 4.0)), torch.full((3, 1, 32), 2.0))
