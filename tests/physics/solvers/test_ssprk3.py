"""Finite differences: stable at fronts, and of order two in space."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate


def shock(make_system, points, dt):
    return make_system(f"""
        axes: {{x: {{length: 1, points: {points}}}}}
        fields: {{u: velocity}}
        parameters: {{}}
        equations: {{u: "-flux(u**2/2, x)"}}
        start: {{u: "step(x - 0.25)*step(0.5001 - x)"}}
        integrator: {{space: finite-difference, dt: {dt}}}
    """)


def test_a_shock_moves_at_its_speed_without_overshoot(make_system):
    system = shock(make_system, 200, 0.002)
    start = nominal_start(system)
    path = simulate(system, start, torch.tensor([0.0, 0.3]).double())[0, :, 0]
    assert float(path.max()) <= 1 + 1e-12
    assert float(path.min()) >= -1e-12
    assert float(path[1].sum()) == pytest.approx(float(path[0].sum()), rel=1e-12)
    x = system.grid.coordinates["x"]
    ahead = x[(path[1] > 0.5)].max()
    assert float(ahead) == pytest.approx(0.5 + 0.3 / 2, abs=0.01)


def test_heat_on_finite_differences_converges_with_order_two_in_space(make_system):
    errors = []
    for points in (16, 32):
        system = make_system(f"""
            axes: {{x: {{length: 2*pi, points: {points}}}}}
            fields: {{u: heat}}
            parameters: {{}}
            equations: {{u: lap(u)}}
            start: {{u: sin(x)}}
            integrator: {{space: finite-difference, dt: 0.002}}
        """)
        path = simulate(system, nominal_start(system), torch.tensor([0.0, 1.0]).double())
        errors.append(float((path[0, 1, 0] / path[0, 0, 0])[1]) - math.exp(-1))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)
