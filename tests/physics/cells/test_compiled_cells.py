"""Compiled finite volumes give the trajectories and tangents of the interpreted ones."""

from __future__ import annotations

from functools import partial

import pytest
import torch

from dashred.physics.cells.compiled import CompiledCells
from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.compiled_simulator import compile_system
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import Term
from dashred.physics.tangents.cell_tangents import tangent_cells
from dashred.physics.terms.library import resolve

TEXTS = [("u", "u**2"), ("u", "d(v, x, 2)"), ("v", "d(v, x)"), ("v", "u*d(u, x)")]


def test_compiled_and_interpreted_runs_agree(make_system):
    system = make_system("""
        axes:
          x:
            length: 1
            points: 10
            ends: {left: {value: cos(4*t)}, right: {u: {slope: t}, v: fixed}}
        fields: {u: heat, v: water}
        equations: {u: "d((1 + x)*d(u, x), x) - u*v", v: "0.3*d(v, x, 2) + d(u, x)"}
        start: {u: 1, v: 1 - x}
        integrator: {dt: 0.02}
    """)
    terms = resolve(system, [Term(e, system.parse(text, "term")) for e, text in TEXTS])
    times = torch.tensor([0.0, 0.1, 0.15], dtype=torch.float64)
    weights = torch.tensor([[0.3, 0.0, -0.2, 0.0], [0.0, 0.1, 0.0, 0.4]], dtype=torch.float64)
    start = nominal_start(system).expand(2, -1, -1).clone()
    basis = ForcingBasis.over(system, times, 3, 2)
    force = basis.sampled_forcing(torch.rand((2, *basis.shape), dtype=torch.float64))
    compiled = compile_system(system, terms)
    assert isinstance(compiled, CompiledCells)
    law = Forcing(terms, weights)
    expected = simulate(system, start, times, law, sampled_forcing=force)
    assert compiled(start, times, weights, force) == pytest.approx(expected, abs=1e-12)
    row = Forcing(terms, weights[:1]), [(term,) for term in terms], force.row(0), basis
    directions = torch.rand((1, 2, 21), dtype=torch.float64)
    run = partial(tangent_cells, system, start[0], directions, times, *row)
    reference = partial(compiled.stages, weights[:1], force.row(0))
    for expected_pair, found in zip(run(), run(reference=reference), strict=True):
        assert found[0] == pytest.approx(expected_pair[0], abs=1e-12)
        assert found[1] == pytest.approx(expected_pair[1], abs=1e-10)
