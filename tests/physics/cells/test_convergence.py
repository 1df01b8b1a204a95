"""Every condition at an end and every coordinate against an analytic solution: order two."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.special import j0, j1

from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate

pi = math.pi
END = 0.1
# J0(2 r) as a series, for the start.
BESSEL = "1-r**2+r**4/4-r**6/36+r**8/576-r**10/14400+r**12/518400"

CASES = {
    "values": (
        "{left: {value: 0}, right: {value: t}}",
        "d(u, x, 2) + x",
        "sin(pi*x)",
        lambda x, t: x * t + math.exp(-(pi**2) * t) * np.sin(pi * x),
    ),
    "value and insulated": (
        "{left: {value: 1}, right: insulated}",
        "lap(u)",
        "1 + sin(pi*x/2)",
        lambda x, t: 1 + math.exp(-((pi / 2) ** 2) * t) * np.sin(pi / 2 * x),
    ),
    "fixed and slope": (
        "{left: fixed, right: {u: {slope: 1 - t}}}",
        "d(u, x, 2) - x",
        "x + sin(pi*x/2)",
        lambda x, t: x * (1 - t) + math.exp(-((pi / 2) ** 2) * t) * np.sin(pi / 2 * x),
    ),
    "slopes": (
        "{left: {slope: 0}, right: {slope: 2}}",
        "d(u, x, 2)",
        "x**2 + cos(pi*x)",
        lambda x, t: 2 * t + x**2 + math.exp(-(pi**2) * t) * np.cos(pi * x),
    ),
    "fluxes": (
        "{left: {flux: -1.5}, right: {flux: -1.5}}",
        "0.5*d(u, x, 2)",
        "3*x + cos(pi*x)",
        lambda x, t: 3 * x + math.exp(-0.5 * pi**2 * t) * np.cos(pi * x),
    ),
    "outflow": (
        "{left: {value: sin(-3*t)}, right: outflow}",
        "-d(u, x)",
        "sin(3*x)",
        lambda x, t: np.sin(3 * (x - t)),
    ),
    "advection to the left": (
        "{left: outflow, right: {value: sin(3*(1 + t))}}",
        "d(u, x)",
        "sin(3*x)",
        lambda x, t: np.sin(3 * (x + t)),
    ),
    "coefficient along the axis": (
        "{left: {flux: 0}, right: {flux: -4*exp(-t)}}",
        "d((1 + x)*d(u, x), x) - exp(-t)*(x**2 + 2 + 4*x)",
        "x**2",
        lambda x, t: math.exp(-t) * x**2,
    ),
    "nonlinear diffusion": (
        "{left: {value: exp(-t)}, right: {value: 2*exp(-t)}}",
        "d(u*d(u, x), x) - u - exp(-2*t)",
        "1 + x",
        lambda x, t: math.exp(-t) * (1 + x),
    ),
    "value on a radius": (
        f"{{right: {{value: exp(-4*t)*{float(j0(2.0))!r}}}}}",
        "lap(u)",
        BESSEL,
        lambda r, t: math.exp(-4 * t) * j0(2 * r),
    ),
    "flux on a radius": (
        f"{{right: {{flux: exp(-4*t)*{float(2 * j1(2.0))!r}}}}}",
        "d(r*d(u, r), r)/r",
        BESSEL,
        lambda r, t: math.exp(-4 * t) * j0(2 * r),
    ),
}


def error(make_system, case, cells):
    ends, equation, start, exact = CASES[case]
    axis = "r" if "radius" in case else "x"
    radial = "coordinates: radial, " if "radius" in case else ""
    system = make_system(f"""
        axes: {{{axis}: {{length: 1, points: {cells}, {radial}ends: {ends}}}}}
        fields: {{u: a quantity}}
        equations: {{u: "{equation}"}}
        start: {{u: "{start}"}}
        integrator: {{dt: 0.004}}
    """)
    times = torch.tensor([0.0, END], dtype=torch.float64)
    found = simulate(system, nominal_start(system), times)[0, -1, 0]
    place = system.grid.coordinates[axis].numpy()
    return float(np.abs(found.numpy() - exact(place, END)).max())


@pytest.mark.parametrize("case", [case for case in CASES if case != "nonlinear diffusion"])
def test_the_error_falls_with_the_square_of_the_cell(make_system, case):
    coarse, fine = error(make_system, case, 16), error(make_system, case, 32)
    assert fine < 5e-3
    assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.15)


def test_a_straight_line_is_exact(make_system):
    assert error(make_system, "nonlinear diffusion", 8) < 1e-9


def test_stiff_diffusion_sets_no_limit_to_the_step(make_system):
    system = make_system("""
        axes: {x: {length: 1, points: 64, ends: {left: {value: 1}, right: insulated}}}
        fields: {u: heat}
        equations: {u: "d((1 + x)*d(u, x), x)"}
        start: {u: 0}
        integrator: {dt: 1}
    """)
    times = torch.tensor([0.0, 5.0], dtype=torch.float64)
    assert simulate(system, nominal_start(system), times)[0, -1].min() == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize("ends", ["{right: insulated}", "insulated"])
def test_an_insulated_cylinder_keeps_its_content(make_system, ends):
    system = make_system(f"""
        axes: {{r: {{length: 2, points: 12, coordinates: radial, ends: {ends}}}}}
        fields: {{u: heat}}
        equations: {{u: 0.3*lap(u)}}
        start: {{u: exp(-r**2)}}
        integrator: {{dt: 0.05}}
    """)
    states = simulate(system, nominal_start(system), torch.tensor([0.0, 1.0]).double())[0, :, 0]
    r = system.grid.coordinates["r"]
    content = (states * r)[:, 1::2].sum(dim=1)
    assert float(content[1]) == pytest.approx(float(content[0]), rel=1e-12)
    assert float(states[1].std()) < 0.8 * float(states[0].std())


def test_an_upwind_flux_moves_a_shock_at_its_speed(make_system):
    system = make_system("""
        axes: {x: {length: 1, points: 100, ends: {left: {value: 1}, right: outflow}}}
        fields: {u: velocity}
        equations: {u: "-flux(u**2/2, x)"}
        start: {u: step(0.3 - x)}
        integrator: {dt: 0.005}
    """)
    found = simulate(system, nominal_start(system), torch.tensor([0.0, 0.5]).double())[0, -1, 0]
    x = system.grid.coordinates["x"]
    assert float(x[found > 0.5].max()) == pytest.approx(0.55, abs=0.015)
    assert float(found[1::2].max()) < 1.01
