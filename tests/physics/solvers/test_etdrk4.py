"""The exponential integrator: exact where it says so, of order four where not."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
import torch
from scipy.special import ive

from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate

BURGERS = """
axes: {{x: {{length: 2*pi, points: {points}}}}}
fields: {{u: velocity}}
parameters: {{nu: 0.2}}
equations: {{u: "{equation}"}}
start: {{u: sin(x)}}
integrator: {{dt: {dt}, dealias: {dealias}}}
"""
ADVECTIVE, CONSERVATIVE = "-u*d(u, x) + nu*lap(u)", "nu*d(u, x, 2) - d(u**2/2, x)"


def cole_hopf(x, t, nu=0.2):
    """Exact solution from sin(x): ``u = -2ν φ_x/φ``, φ a sum of Bessel functions I_n(1/2ν)."""
    n = torch.arange(1.0, 60.0).double()[:, None]
    weights = 2 * torch.as_tensor(ive(n.numpy(), 1 / (2 * nu))) * torch.exp(-nu * n**2 * t)
    phi = float(ive(0, 1 / (2 * nu))) + (weights * torch.cos(n * x)).sum(0)
    slope = -(weights * n * torch.sin(n * x)).sum(0)
    return -2 * nu * slope / phi


def run(system, *times):
    clock = torch.tensor(times, dtype=torch.float64)
    return simulate(system, nominal_start(system), clock)[0, :, 0]


def burgers(make_system, dt, equation=ADVECTIVE, points=64, dealias="false"):
    text = BURGERS.format(points=points, dt=dt, equation=equation, dealias=dealias)
    system = make_system(text)
    found = run(system, 0.0, 1.0)[-1]
    return float((found - cole_hopf(system.grid.coordinates["x"], 1.0)).abs().max())


@pytest.mark.parametrize("equation", [ADVECTIVE, CONSERVATIVE])
def test_burgers_agrees_with_cole_hopf_and_converges_with_order_four(make_system, equation):
    errors = [burgers(make_system, dt, equation) for dt in ("1/10", "1/20", "1/40")]
    orders = [math.log2(a / b) for a, b in pairwise(errors)]
    assert orders == pytest.approx([4.0, 4.0], abs=0.35)
    assert errors[-1] < 1e-7


def test_the_two_thirds_rule_keeps_a_resolved_solution(make_system):
    assert burgers(make_system, "1/40", CONSERVATIVE, 96, "true") < 1e-7


def test_the_two_thirds_rule_empties_the_upper_third(make_system):
    text = BURGERS.format(points=24, dt=0.02, equation=CONSERVATIVE, dealias="true")
    system = make_system(text)
    start = torch.randn(1, 1, 24, generator=torch.Generator().manual_seed(0)).double()
    path = simulate(system, start, torch.tensor([0.0, 0.1]).double())
    spectrum = torch.fft.rfft(path[0, -1, 0]).abs()
    assert spectrum[8:].max() < 1e-13 < spectrum[7]


def linear(make_system, equation, dt, *words):
    text = f"""
        axes: {{x: {{length: 2*pi, points: 32}}}}
        fields: {{u: heat}}
        parameters: {{D: 0.3, c: 1.7, mu: 0.4}}
        equations: {{u: "{equation}"}}
        start: {{u: cos(2*x) + sin(x) + 0.5}}
        integrator: {{dt: {dt}}}
    """
    return make_system(text, *words)


@pytest.mark.parametrize("dt", [1e-2, 0.37, 5.0])
@pytest.mark.parametrize("equation", ["D*lap(u)", "lap(D*u)", "D*(d(u, x, 2) + 0*u)"])
def test_heat_is_exact_for_any_step(make_system, equation, dt):
    system = linear(make_system, equation, dt)
    x = system.grid.coordinates["x"]
    for t, state in zip((0.0, 1.3, 2.0), run(system, 0.0, 1.3, 2.0), strict=True):
        exact = math.exp(-1.2 * t) * torch.cos(2 * x) + math.exp(-0.3 * t) * torch.sin(x) + 0.5
        torch.testing.assert_close(state, exact, rtol=0, atol=1e-12)


@pytest.mark.parametrize("dt", [0.05, 2.0])
def test_advection_with_growth_is_exact_for_any_step(make_system, dt):
    system = linear(make_system, "mu*u - c*d(u, x)", dt)
    x = system.grid.coordinates["x"] - 1.7 * 2.0
    exact = math.exp(0.8) * (torch.cos(2 * x) + torch.sin(x) + 0.5)
    torch.testing.assert_close(run(system, 0.0, 2.0)[-1], exact, rtol=0, atol=1e-12)


def test_heat_is_exact_in_the_plane(make_system):
    system = make_system("""
        axes: {x: {length: 2*pi, points: 12}, y: {length: pi, points: 15}}
        fields: {u: heat}
        parameters: {}
        equations: {u: "0.1*lap(u) - d(u, y) + 0.2*inv_lap(u)"}
        start: {u: cos(2*x)*sin(4*y)}
        integrator: {dt: 1}
    """)
    x, y = system.grid.coordinates.values()
    exact = math.exp(-2 * 2.0 - 0.2 / 20 * 2.0) * torch.cos(2 * x) * torch.sin(4 * (y - 2.0))
    torch.testing.assert_close(run(system, 0.0, 2.0)[-1], exact, rtol=0, atol=1e-12)


def test_an_explicit_clock_and_coordinate_are_read(make_system):
    system = linear(make_system, "cos(x)*t", 0.1)
    start = nominal_start(system)[0, 0]
    found = run(system, 2.0, 3.0)[-1]
    exact = start + torch.cos(system.grid.coordinates["x"]) * (9 - 4) / 2
    torch.testing.assert_close(found, exact, rtol=0, atol=1e-12)


def test_a_tiny_unit_of_time_loses_no_digits(make_system):
    system = linear(
        make_system, "1e12*D*lap(u)", "1e-13/3", "recording.duration=1e-12", "recording.every=1e-13"
    )
    found = run(system, 0.0, 1e-12)[-1]
    x = system.grid.coordinates["x"]
    exact = math.exp(-1.2) * torch.cos(2 * x) + math.exp(-0.3) * torch.sin(x) + 0.5
    torch.testing.assert_close(found, exact, rtol=0, atol=1e-10)


def test_a_growing_mode_amplifies_no_mode_that_the_grid_cannot_see(make_system):
    """Rounding in the anti-Hermitian part of a 2D spectrum, left alone, would grow by e^60."""
    system = make_system("""
        axes: {x: {length: 2*pi, points: 8}, y: {length: 2*pi, points: 8}}
        fields: {u: height}
        parameters: {}
        equations: {u: 2*u - u**3}
        start: {u: 1 + 0.5*cos(x)*cos(y) + 0.3*sin(x)}
        integrator: {dt: 0.1}
    """)
    times = torch.linspace(0.0, 60.0, 61, dtype=torch.float64)
    final = simulate(system, nominal_start(system), times)[0, -1, 0]
    torch.testing.assert_close(final, torch.full_like(final, math.sqrt(2)), rtol=0, atol=1e-9)
