"""Tangents of finite volumes against differences of trajectories."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.parameter_sensitivity import parameter_tendency
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import Term
from dashred.physics.tangents.cell_tangents import has_cell_tangents, tangent_cells
from dashred.physics.terms.library import resolve

TIMES = torch.tensor([0.0, 0.05, 0.13], dtype=torch.float64)
STEP = 1e-5
PARAMETERS = ["a", "b", "u_left_offset", "u_right_offset", "v_left_offset", "v_right_offset"]


@pytest.fixture
def system(make_system):
    return make_system("""
        axes:
          x:
            length: 1
            points: 12
            ends:
              left: {u: {value: 1 + a*sin(3*t)}, v: {slope: 0.3}}
              right: {u: {flux: b*t}, v: {value: 0.2*t}}
        fields: {u: heat, v: water}
        parameters: {a: 0.5, b: 0.3}
        equations:
          u: d((1 + 0.4*x)*d(u, x), x) - u*v + u*d(u, x)
          v: 0.2*d(v, x, 2) + 0.3*d(u**2, x) + v*u**2
        start: {u: 1 + 0.3*x, v: 0.3*x + 0.1*x**2}
        integrator: {dt: 0.01}
    """)


def test_tangents_are_derivatives_of_the_trajectory(system):
    start = nominal_start(system)
    texts = {"u": "u**2", "v": "d(v, x)"}
    terms = resolve(system, [Term(e, system.parse(text, "term")) for e, text in texts.items()])
    law = Forcing(terms, torch.tensor([[0.3, -0.2]], dtype=torch.float64))
    generator = torch.Generator().manual_seed(0)
    directions = torch.randn((2, 2, 25), generator=generator, dtype=torch.float64)
    basis = ForcingBasis.over(system, TIMES, 3, 2)
    sources = [(term,) for term in terms]
    assert has_cell_tangents(system, terms)
    *_, (state, columns) = tangent_cells(
        system, start[0], directions, TIMES, law, sources, forcing_basis=basis
    )

    def end(move=0.0, coefficients=0.0, amplitudes=None):
        moved = Forcing(terms, law.coefficients + coefficients)
        force = None if amplitudes is None else basis.sampled_forcing(amplitudes[None])
        return simulate(system, start + move, TIMES, moved, sampled_forcing=force)[0, -1]

    assert torch.equal(state, end())
    for k, direction in enumerate(directions):
        expected = (end(STEP * direction) - end(-STEP * direction)) / (2 * STEP)
        assert columns[k] == pytest.approx(expected, abs=1e-8)
    for k, unit in enumerate(STEP * torch.eye(2, dtype=torch.float64)):
        expected = (end(coefficients=unit) - end(coefficients=-unit)) / (2 * STEP)
        assert columns[2 + k] == pytest.approx(expected, abs=1e-8)
    amplitudes = torch.zeros(basis.shape, dtype=torch.float64)
    amplitudes[1, 2, 1] = STEP
    expected = (end(amplitudes=amplitudes) - end(amplitudes=-amplitudes)) / (2 * STEP)
    last = columns[4 + int(amplitudes.flatten().argmax())]
    assert last == pytest.approx(expected, abs=1e-8)


def test_a_change_of_a_condition_is_a_source(system):
    start = nominal_start(system)
    sources = [
        tuple(Term(*item) for item in parameter_tendency(system, name).items())
        for name in PARAMETERS
    ]
    none = torch.zeros((0, 2, 25), dtype=torch.float64)
    *_, (_, columns) = tangent_cells(system, start[0], none, TIMES, None, sources)
    for name, column in zip(PARAMETERS, columns, strict=True):
        ends = []
        for sign in (1, -1):
            value = system.config.parameters[name] + sign * STEP
            parameters = system.config.parameters | {name: value}
            moved = system.with_config(dataclasses.replace(system.config, parameters=parameters))
            ends.append(simulate(moved, start, TIMES)[0, -1])
        difference = (ends[0] - ends[1]) / (2 * STEP)
        assert column[:, 1::2] == pytest.approx(difference[:, 1::2], abs=1e-8)


def test_upwind_fluxes_have_no_tangents(make_system):
    system = make_system("""
        axes: {x: {length: 1, points: 8, ends: {left: {value: 1}, right: outflow}}}
        fields: {u: velocity}
        equations: {u: "-flux(u**2/2, x)"}
        start: {u: 1}
        integrator: {dt: 0.01}
    """)
    assert not has_cell_tangents(system, ())
