"""The loss over states: that of the networks, its derivatives, and its minimum."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.models.dynamics.gauss_newton import minimise
from dashred.models.dynamics.network_assimilation import LEAST_ERROR
from dashred.models.dynamics.sampled_dynamics import EpisodeSteps
from dashred.models.dynamics.state_fit import FIRST_ERROR
from dashred.models.dynamics.unknowns import Unknowns
from dashred.models.dynamics.weak_constraint import WeakConstraint
from dashred.physics.solvers.sample_step import SampleStep
from tests import ring
from tests.models.dynamics.test_dynamic_assimilation import (
    data,
    losses,
    make,
    real,
    short,
    shred,
    system,
)

__all__ = ["data", "real", "short", "shred", "system"]

LAW = torch.tensor([0, -0.1, 0, 0, 0.02, 0, 0, 0]).double()


def never() -> bool:
    return False


def problem_of(module, readings: Tensor) -> tuple[WeakConstraint, Unknowns]:
    """Return the loss of a module over states, and the states of its networks."""
    law = module.dynamics.coefficients.detach() / module.dynamics.scales
    return module.loss(readings).problem, Unknowns(module.basis.guess.double(), law)


def test_it_is_the_loss_of_the_networks_times_the_number_of_readings(system, shred, data):
    data.fitted[3:9, 0] = torch.nan
    module = make(system, shred, data)
    module.dynamics.set_law(LAW)
    problem, at = problem_of(module, data.fitted)
    found, expected = problem.residuals(at, FIRST_ERROR, 1.0), losses(module, data)
    assert found.cost == pytest.approx(problem.count * float(expected["train"]), rel=1e-4)
    parts = {"misfit": "misfit", "forecast_misfit": "forecast_misfit", "step": "step_error"}
    for own, name in parts.items():
        value = float(getattr(found, own).square().sum()) / problem.count
        assert value == pytest.approx(float(expected[name]), rel=1e-4)


def test_the_first_sample_of_an_episode_has_a_background_of_its_own(system, shred, data):
    problem, at = problem_of(make(system, shred, data), data.fitted)
    moved = at.moved(torch.ones_like(at.states), torch.zeros(0).double(), [])
    assert not problem.residuals(at, FIRST_ERROR, 1.0).start.any()
    found = problem.residuals(moved, FIRST_ERROR, 1.0).start
    assert torch.equal(found[0], torch.ones_like(found[0])) and not found[1:].any()


@pytest.mark.parametrize("episodes", [1, 2])
def test_the_equations_are_those_of_the_linearised_residuals(system, shred, data, episodes):
    data.fitted[3:9, 0] = torch.nan
    module = make(system, shred, data)
    if episodes == 2:
        half = len(ring.TIMES) // 2
        parts = ((ring.TIMES[:half], 0), (ring.TIMES[half:], half))
        module.dynamics.episodes = tuple(
            EpisodeSteps(SampleStep(system, 0.1), times, first) for times, first in parts
        )
    module.dynamics.set_law(LAW)
    problem, at = problem_of(module, data.fitted)
    terms, small, rng = [1, 4], 1e-5, torch.Generator().manual_seed(1)
    x = torch.randn(at.states.shape, generator=rng, dtype=torch.float64)
    z = torch.randn(len(terms), generator=rng, dtype=torch.float64)
    there, back = (
        problem.residuals(at.moved(h * x, h * z, terms), FIRST_ERROR, 0.3) for h in (small, -small)
    )
    own = problem.residuals(at, FIRST_ERROR, 0.3)
    equations = problem.equations(at, terms, FIRST_ERROR, 0.3, never)
    slopes = {name: (vars(there)[name] - vars(back)[name]) / (2 * small) for name in vars(own)}
    gradient = sum(float((slopes[name] * vars(own)[name]).sum()) for name in slopes)
    dx, dz = x.numpy(), z.numpy()
    found = (equations.node_gradient * dx).sum() + (equations.shared_gradient * dz).sum()
    assert -found == pytest.approx(gradient, rel=1e-5)
    assert equations.cost == own.cost
    square = sum(float(slope.square().sum()) for slope in slopes.values())
    across = (equations.upper @ dx[1:, :, None])[..., 0]
    curvature = (
        (dx[:, None] @ equations.diagonal @ dx[..., None]).sum()
        + 2 * (dx[:-1] * across).sum()
        + 2 * (dx * (equations.border @ dz)).sum()
        + dz @ equations.corner @ dz
    )
    assert float(curvature) == pytest.approx(square, rel=1e-5)
    if episodes == 2:
        assert not equations.upper[half - 1].any()


def test_one_step_solves_a_linear_problem(system, shred, data):
    module = make(system, shred, data)
    problem, at = problem_of(module, data.fitted)
    step = problem.equations(at, [], 0.03, 0.1, never).step(0.0)
    assert step is not None
    states = torch.from_numpy(step[0])
    solved = Unknowns(at.states + states, at.law)
    equations = problem.equations(solved, [], 0.03, 0.1, never)
    assert np.abs(equations.node_gradient).max() < 1e-4 * float(states.abs().max())
    found, residuals = minimise(problem, at, [], 0.03, 0.1, never)
    assert residuals.cost == pytest.approx(problem.residuals(solved, 0.03, 0.1).cost, rel=1e-3)
    assert residuals.cost < 0.1 * problem.residuals(at, 0.03, 0.1).cost
    assert found.states.shape == at.states.shape


def test_the_law_is_found_beside_the_states(system, shred, data, real):
    module = make(system, shred, data)
    module.dynamics.set_law(torch.tensor([0, -0.05, 0, 0, 0, 0, 0, 0]).double())
    fitted = module.loss(data.fitted).fit(module.basis.guess.double(), LEAST_ERROR).fitted
    assert float(fitted.coefficients[1]) == pytest.approx(-0.3, rel=0.05)
    assert fitted.coefficients.nonzero().flatten().tolist() == [1]
    assert fitted.parts["step_error"] < 1
    before = (module.first_guess - real).square().mean().sqrt()
    problem, _ = problem_of(module, data.fitted)
    after = (problem.fields(fitted.unknowns.states) - real).square().mean().sqrt()
    assert float(after) < 0.1 * float(before)


def test_the_equations_of_the_law_are_positive_definite(system, shred, data):
    module = make(system, shred, data)
    fit = module.loss(data.fitted)
    at = fit.fit(module.basis.guess.double(), 0.01).fitted.unknowns
    found = fit.law_equations(at, 0.01)
    assert found is not None
    gram, target, _ = found
    assert np.linalg.eigvalsh(gram).min() >= 0.99 * fit.problem.precision
    # The term that the simulator lacks lowers the loss more than any other.
    assert (target**2 / gram.diagonal()).argmax() == 1


def test_a_simulator_that_blows_up_leaves_the_states_as_they_are(system, shred, data):
    module = make(system, shred, data)
    library = [str(term) for term in ring.library(system)]
    law = torch.zeros(len(library)).double()
    law[library.index("u**3")] = 1e3
    module.dynamics.set_law(law)
    problem, at = problem_of(module, data.fitted)
    found, residuals = minimise(problem, at, [], FIRST_ERROR, 1.0, never)
    assert not math.isfinite(residuals.cost)
    assert torch.equal(found.states, at.states)


@pytest.mark.parametrize("looks", [0, 3])
def test_it_ends_when_the_time_is_up(system, shred, data, looks):
    module, seen = make(system, shred, data), []
    problem, at = problem_of(module, data.fitted)

    def is_over() -> bool:
        seen.append(1)
        return len(seen) > looks

    found, _ = minimise(problem, at, [], FIRST_ERROR, 1.0, is_over)
    assert torch.equal(found.states, at.states) and len(seen) == looks + 1
