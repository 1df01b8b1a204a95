"""Tangents of a program with a law, against those of the same equations."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.program_parameters import parameter_term
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.tangents.ode_tangents import tangent_ode
from dashred.physics.tangents.program_tangents import tangent_program
from dashred.physics.tangents.tangent_linear import tangent_linear
from dashred.physics.terms.library import resolve

# Factor of the law in each trajectory.
EACH = torch.tensor([[1.0], [-1.0]]).double()
STRING = """
    axes: {x: {length: 2*pi, points: 32}}
    fields: {u: place, v: velocity}
    simulator: {function: tests.programs.string}
    start: {u: sin(x) + 0.3*cos(8*x), v: 0}
    integrator: {dt: 0.05, dealias: true}
"""
TIMES = torch.linspace(0, 2, 21, dtype=torch.float64)
PENDULUM = """
    fields: {theta: angle, omega: rate}
    parameters: {g: 4.0}
    BODY
    start: {theta: 1.2, omega: 0.3}
    integrator: {dt: 0.0125}
"""
HEAT = """
    axes: {x: {length: 2*pi, points: 32}}
    fields: {u: temperature}
    parameters: {kappa: 0.3}
    BODY
    start: {u: 1 + sin(x) + 0.3*cos(3*x)}
    integrator: {dt: 0.0125}
"""


def terms(system: System, *listed: tuple[str, str]) -> tuple[Term, ...]:
    return resolve(system, [Term(e, system.parse(t, "test", equation=e)) for e, t in listed])


def stacked(samples) -> tuple[Tensor, Tensor]:
    states, columns = zip(*samples, strict=True)
    return torch.stack(states), torch.stack(columns)


def relative(found: Tensor, expected: Tensor) -> Tensor:
    """Return the error of every column, ``(column,)``."""
    found, expected = (each.transpose(0, 1).flatten(1) for each in (found, expected))
    return (found - expected).norm(dim=1) / expected.norm(dim=1)


def pendulums(make_system) -> tuple[System, System]:
    """Return a pendulum by its equations, and as a program."""
    known = make_system(PENDULUM.replace("BODY", "equations: {theta: omega, omega: -g*sin(theta)}"))
    program = make_system(
        PENDULUM.replace("BODY", "simulator: {function: tests.programs.pendulum}"),
        "trust=tests.programs.pendulum",
        "recording.path=recorded.csv",
    )
    return known, program


def test_columns_of_an_ode_are_those_of_its_equations(make_system) -> None:
    known, program = pendulums(make_system)
    start, eye = nominal_start(known)[0], torch.eye(2, dtype=torch.float64)
    forcing = Forcing(terms(known, ("omega", "omega")), torch.tensor([[-0.3]]).double())
    sources = [terms(known, ("omega", "omega")), terms(known, ("theta", "sin(theta)"))]
    basis = ForcingBasis.over(known, TIMES, 1, 3)
    pushed = SampledForcing(TIMES[[0, -1]], torch.tensor([[[0.0, 0.1], [0.0, -0.2]]]).double())
    parts = start, eye, TIMES, forcing, sources, pushed, basis
    states, columns = stacked(tangent_ode(known, *parts))
    found_states, found = stacked(tangent_program(program, *parts))
    assert found.shape == (21, 2 + 2 + 6, 2)
    torch.testing.assert_close(found_states, states, rtol=1e-4, atol=1e-4)
    assert relative(found, columns).max() < 1e-3
    [own] = simulate(program, start[None], TIMES, forcing, sampled_forcing=pushed)
    torch.testing.assert_close(found_states, own, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("name", "limit"), [("heat", 2e-3), ("heat_of_singles", 1e-2)])
@pytest.mark.parametrize("directions", [2, 40])
def test_columns_of_a_field_are_those_of_its_equations(
    make_system, name: str, limit: float, directions: int
) -> None:
    known = make_system(HEAT.replace("BODY", "equations: {u: kappa*lap(u)}"))
    body = f"simulator: {{function: tests.programs.{name}}}"
    words = f"trust=tests.programs.{name}", "recording.path=recorded.csv"
    program = make_system(HEAT.replace("BODY", body), *words)
    start = nominal_start(known)[0]
    # More directions than values: the derivative is that along every value.
    random = torch.randn((directions, 1, 32), generator=torch.Generator().manual_seed(0)).double()
    forcing = Forcing(terms(known, ("u", "u**2")), torch.tensor([[-0.2]]).double())
    sources = [terms(known, ("u", term)) for term in ("u", "u*d(u, x)", "lap(u)")]
    basis = ForcingBasis.over(known, TIMES, 3, 3)
    parts = start, random, TIMES, forcing, sources
    expected = stacked(tangent_linear(known, *parts, forcing_basis=basis))[1]
    found = stacked(tangent_program(program, *parts, forcing_basis=basis))[1]
    assert relative(found, expected).max() < limit


@pytest.mark.parametrize("pushes", [True, False])
def test_columns_of_a_forcing_without_a_law(make_system, pushes: bool) -> None:
    heat = HEAT.replace("0.0125}", "0.0125, dealias: true}")
    known = make_system(heat.replace("BODY", "equations: {u: kappa*lap(u)}"))
    body = "simulator: {function: tests.programs.heat}"
    words = "trust=tests.programs.heat", "recording.path=recorded.csv"
    program = make_system(heat.replace("BODY", body), *words)
    x = 2 * math.pi * torch.arange(32, dtype=torch.float64) / 32
    start, waves = nominal_start(known)[0], torch.stack([x.sin(), (3 * x).cos()])[:, None]
    basis = ForcingBasis.over(known, TIMES, 3, 5)
    pushed = SampledForcing(TIMES[[0, -1]], torch.stack([x.sin(), -2 * x.sin()])[None, :, None])
    parts = start, waves, TIMES, None, [terms(known, ("u", "u**2"))]
    force = pushed if pushes else None
    states, found = stacked(tangent_program(program, *parts, force, basis))
    expected_states, expected = stacked(
        tangent_linear(known, *parts, sampled_forcing=force, forcing_basis=basis)
    )
    torch.testing.assert_close(states, expected_states, rtol=1e-4, atol=1e-4)
    assert relative(found, expected).max() < 1e-4


def test_the_column_of_a_parameter_of_the_program_is_that_of_the_equations(make_system) -> None:
    known, program = pendulums(make_system)
    start, eye = nominal_start(known)[0], torch.eye(2, dtype=torch.float64)
    # The law: g is 4.5, and there is a damping. The columns are those by g and by the damping.
    by_equations = terms(known, ("omega", "-sin(theta)"), ("omega", "omega"))
    by_program = parameter_term("g"), by_equations[1]
    size = torch.tensor([[0.5, -0.3]]).double()
    laws = Forcing(by_equations, size), Forcing(by_program, size)
    sources = [(term,) for term in by_equations], [(term,) for term in by_program]
    states, columns = stacked(tangent_ode(known, start, eye, TIMES, laws[0], sources[0]))
    found_states, found = stacked(tangent_program(program, start, eye, TIMES, laws[1], sources[1]))
    torch.testing.assert_close(found_states, states, rtol=1e-4, atol=1e-4)
    assert relative(found, columns).max() < 1e-3
    both = simulate(program, start.expand(2, -1), TIMES, Forcing(by_program, size * EACH))
    torch.testing.assert_close(both[0], found_states, rtol=1e-12, atol=1e-12)
    [alone] = simulate(known, start[None], TIMES, Forcing(by_equations, -size))
    torch.testing.assert_close(both[1], alone, rtol=1e-4, atol=1e-4)


def test_columns_of_a_field_that_starts_at_zero_are_those_of_the_steps(make_system) -> None:
    system = make_system(STRING, "trust=tests.programs.string", "recording.path=recorded.csv")
    start, x = nominal_start(system)[0], system.grid.coordinates["x"]
    directions = torch.stack([0 * start, 0 * start])
    directions[0, 0], directions[1, 1] = torch.cos(x), torch.cos(2 * x)
    own = terms(system, ("u", "v"), ("v", "u**3"), ("v", "d(v, x)"))
    weights = torch.tensor([-0.3, 0.2, 0.0]).double()
    sources = [(term,) for term in own]
    forcing = Forcing(own, weights[None])
    times = TIMES[:11]
    _, columns = stacked(tangent_program(system, start, directions, times, forcing, sources))

    def run(moved: Tensor, by: Tensor) -> Tensor:
        return simulate(system, moved[None], times, Forcing(own, (weights + by)[None]))[0]

    small, units = 1e-6, torch.eye(3, dtype=torch.float64)
    ways = [(direction, 0 * units[0]) for direction in directions]
    ways += [(0 * start, unit) for unit in units]
    pairs = [
        (run(start + small * a, small * b), run(start - small * a, -small * b)) for a, b in ways
    ]
    expected = torch.stack([(later - before) / (2 * small) for later, before in pairs], dim=1)
    assert relative(columns, expected).max() < 2e-4
