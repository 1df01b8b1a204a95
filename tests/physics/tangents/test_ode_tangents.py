"""Tangents of systems without axes, against central differences of the simulator itself."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.compiled_simulator import compile_system
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.tangents.ode_tangents import has_ode_tangents, tangent_ode
from dashred.physics.terms.library import resolve
from tests import laws

TIMES = torch.tensor([0.5, 0.6, 0.93, 1.0, 1.7, 3.1]).double()
TEXT = """
system:
  title: a pendulum that is pushed
  fields: {theta: angle, omega: rate}
  parameters: {g: 4.0, c: 0.1}
  equations:
    theta: omega
    omega: -g*sin(theta) - c*omega*abs(omega) + 0.3*cos(2*t)*theta
  start: {theta: 1.2, omega: 0.3}
  spread: {theta: 0.1, omega: 0.1}
  integrator: {method: rk4, dt: 0.02}
recording: {twin: a, sensors: 2, noise: 0, duration: 4, every: 0.1}
"""
SOURCES = [
    [("omega", "omega")],
    [("omega", "theta**2*omega")],
    [("theta", "1"), ("omega", "sin(t)")],
    [("omega", "tanh(5*(t - 1.5))*theta")],
]


@pytest.fixture
def system(tmp_path: Path) -> System:
    return laws.declared(tmp_path, TEXT)


def terms(system: System, listed: list[tuple[str, str]]) -> tuple[Term, ...]:
    return resolve(system, [Term(e, system.parse(t, "test", equation=e)) for e, t in listed])


@pytest.fixture
def forcing(system: System) -> Forcing:
    coefficients = torch.tensor([[-0.2, 0.05]], dtype=torch.float64)
    return Forcing(terms(system, [("omega", "omega"), ("theta", "theta**3")]), coefficients)


def test_columns_are_the_derivatives_of_the_run(system: System, forcing: Forcing) -> None:
    start, h = nominal_start(system)[0], 1e-5
    directions = torch.tensor([[1.0, 0.0], [0.3, -0.7]], dtype=torch.float64)
    sources = [terms(system, several) for several in SOURCES]
    found = list(tangent_ode(system, start, directions, TIMES, forcing, sources))
    states, columns = (torch.stack(part) for part in zip(*found, strict=True))
    expected = simulate(system, start[None], TIMES, forcing)[0]
    torch.testing.assert_close(states, expected, rtol=1e-10, atol=1e-10)
    for j, direction in enumerate(directions):
        both = torch.stack([start + h * direction, start - h * direction])
        doubled = Forcing(forcing.terms, forcing.coefficients.expand(2, -1))
        ahead, behind = simulate(system, both, TIMES, doubled)
        torch.testing.assert_close(columns[:, j], (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-7)
    for j, several in enumerate(sources, 2):
        held = [*forcing.coefficients[0].tolist()]
        rows = [[*held, *[sign * h] * len(several)] for sign in (1, -1)]
        more = Forcing((*forcing.terms, *several), torch.tensor(rows, dtype=torch.float64))
        ahead, behind = simulate(system, start.expand(2, -1), TIMES, more)
        torch.testing.assert_close(columns[:, j], (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-7)


def test_a_free_forcing_is_carried_and_differentiated(system: System, forcing: Forcing) -> None:
    start, h = nominal_start(system)[0], 1e-5
    forcing_basis = ForcingBasis.over(system, TIMES, 1, 4)
    run = compile_system(system, forcing.terms)
    amplitudes = 0.3 * torch.randn(
        (1, *forcing_basis.shape), generator=torch.Generator().manual_seed(0)
    )

    def moved(change: torch.Tensor) -> torch.Tensor:
        sampled_forcing = forcing_basis.sampled_forcing(amplitudes.double() + change)
        return run(start[None], TIMES, forcing.coefficients, sampled_forcing)[0]

    sampled_forcing: SampledForcing = forcing_basis.sampled_forcing(amplitudes.double())
    none = torch.zeros((0, 2), dtype=torch.float64)
    found = list(
        tangent_ode(system, start, none, TIMES, forcing, [], sampled_forcing, forcing_basis)
    )
    states, columns = (torch.stack(part) for part in zip(*found, strict=True))
    torch.testing.assert_close(states, moved(0 * amplitudes.double()), rtol=1e-11, atol=1e-11)
    assert columns.shape[1] == forcing_basis.count
    for j in range(forcing_basis.count):
        change = torch.zeros(forcing_basis.count, dtype=torch.float64)
        change[j] = h
        step = change.reshape(1, *forcing_basis.shape)
        expected = (moved(step) - moved(-step)) / (2 * h)
        torch.testing.assert_close(columns[:, j], expected, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("term", ["omega**3", "log(theta - 1.1)", "(1.5 - theta)**0.5"])
def test_a_trajectory_that_is_lost_is_told_by_its_values(system: System, term: str) -> None:
    """Until then it is that of the simulator."""
    [pushed] = terms(system, [("omega", term)])
    forcing = Forcing((pushed,), torch.tensor([[40.0]], dtype=torch.float64))
    start = nominal_start(system)[0]
    found = list(tangent_ode(system, start, torch.eye(2).double(), TIMES, forcing, []))
    states, columns = (torch.stack(part) for part in zip(*found, strict=True))
    expected = simulate(system, start[None], TIMES, forcing)[0]
    lost = ~torch.isfinite(expected)
    assert lost.any() and not lost[0].any()
    torch.testing.assert_close(torch.isfinite(states), ~lost)
    torch.testing.assert_close(states[~lost], expected[~lost], rtol=1e-9, atol=1e-9)
    assert not torch.isfinite(columns[-1]).all()


def test_what_it_cannot_carry_is_told(system: System, tmp_path: Path) -> None:
    assert has_ode_tangents(system, ())
    adaptive = laws.declared(tmp_path, TEXT.replace("method: rk4", "method: dopri5"))
    assert not has_ode_tangents(adaptive, ())
