"""Steps from sample to sample: those of the simulator, for states with times of their own."""

from __future__ import annotations

import pytest
import torch

from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.sample_step import SampleStep, is_differentiable
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import Term
from dashred.physics.terms.library import resolve

BEGINS = torch.tensor([0.5, 0.9, 2.0], dtype=torch.float64)
DURATION = 0.17


@pytest.fixture(params=["burgers", "reaction", "plane", "oscillator"])
def system(request):
    return request.getfixturevalue(request.param)


def states_of(system):
    start = nominal_start(system)
    noise = torch.randn((3, *start.shape[1:]), generator=torch.Generator().manual_seed(0))
    return start * (1 + 0.1 * noise.double())


def forcing_of(system, *coefficients):
    field = system.fields[0]
    texts = (field, f"{field}**2")
    terms = [Term(field, system.parse(text, f"library.{field}", equation=field)) for text in texts]
    return Forcing(resolve(system, terms), torch.tensor([coefficients], dtype=torch.float64))


def test_each_state_is_simulated_from_its_own_time(system):
    states, law = states_of(system), forcing_of(system, -0.1, 0.03)
    step = SampleStep(system, DURATION)
    found = step(states, BEGINS, torch.full((3,), DURATION, dtype=torch.float64), law)
    for i, begin in enumerate(BEGINS.tolist()):
        times = torch.tensor([begin, begin + DURATION], dtype=torch.float64)
        expected = simulate(system, states[i : i + 1], times, law)[0, -1]
        torch.testing.assert_close(found[i], expected, rtol=1e-9, atol=1e-12)


def test_ode_steps_may_differ_in_length(oscillator):
    states, durations = states_of(oscillator), torch.tensor([0.05, 0.1, 0.3], dtype=torch.float64)
    found = SampleStep(oscillator.with_step(1e-3), 0.3)(states, BEGINS, durations, None)
    for i, duration in enumerate(durations.tolist()):
        times = torch.tensor([0.0, duration], dtype=torch.float64)
        expected = simulate(oscillator.with_step(1e-3), states[i : i + 1], times)[0, -1]
        torch.testing.assert_close(found[i], expected, rtol=1e-10, atol=1e-12)


def test_the_derivatives_are_those_of_finite_differences(system):
    durations = torch.full((3,), DURATION, dtype=torch.float64)
    step, states = SampleStep(system, DURATION), states_of(system).requires_grad_()
    law = forcing_of(system, -0.1, 0.03)
    law.coefficients.requires_grad_()
    weights = torch.randn(states.shape, generator=torch.Generator().manual_seed(1)).double()
    (step(states, BEGINS, durations, law) * weights).sum().backward()
    assert states.grad is not None
    assert law.coefficients.grad is not None
    moved = torch.randn(states.shape, generator=torch.Generator().manual_seed(2)).double()

    def value(shift, first):
        at = states.detach() + shift * moved
        changed = forcing_of(system, -0.1 + first, 0.03)
        return float((step(at, BEGINS, durations, changed) * weights).sum())

    by_state = (value(1e-5, 0.0) - value(-1e-5, 0.0)) / 2e-5
    assert float((states.grad * moved).sum()) == pytest.approx(by_state, rel=1e-6)
    by_law = (value(0.0, 1e-5) - value(0.0, -1e-5)) / 2e-5
    assert float(law.coefficients.grad[0, 0]) == pytest.approx(by_law, rel=1e-6)


def test_walls_and_adaptive_methods_are_not_stepped(make_system, system):
    assert is_differentiable(system)
    walled = make_system("""
        axes: {x: {length: 1, points: 16, ends: {left: {value: 0}, right: {slope: 0}}}}
        fields: {u: heat}
        parameters: {}
        equations: {u: "0.1*lap(u)"}
        start: {u: 0}
        integrator: {dt: 0.01}
    """)
    assert not is_differentiable(walled)
    adaptive = make_system("""
        fields: {u: level}
        parameters: {}
        equations: {u: -u}
        start: {u: 1}
        integrator: {method: dopri5, dt: 0.1}
    """)
    assert not is_differentiable(adaptive)
