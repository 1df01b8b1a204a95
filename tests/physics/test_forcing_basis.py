"""A free forcing: bumps and hats, the runs that it drives, and the columns of its amplitudes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.physics.forcing_basis import ForcingBasis, SampledForcing, square_mesh
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.compiled_simulator import InterpretedSystem, compile_system
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.physics.tangents.tangent_linear import tangent_linear
from tests import laws

REST = "recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}\n"
WAVE = """
system:
  title: two fields on a ring
  axes: {x: {length: 10, points: 32}}
  fields: {u: first, v: second}
  equations:
    u: u - u**3/3 - v - 0.4*d(u, x) + 0.2*lap(u)
    v: 0.2*(u + 0.7 - 0.8*v)
  start: {u: cos(2*pi*x/10), v: 0.5*sin(2*pi*x/10)}
  integrator: {dt: 0.02}
"""
SWING = """
system:
  title: a swing
  fields: {x: place, p: momentum}
  equations: {x: p, p: -2*sin(x)}
  start: {x: 1, p: 0}
  integrator: {method: rk4, dt: 0.02}
"""
TIMES = torch.linspace(0.0, 2.0, 6, dtype=torch.float64)


@pytest.fixture
def wave(tmp_path: Path) -> System:
    return laws.declared(tmp_path, WAVE + REST)


def test_equal_amplitudes_are_a_constant(wave: System) -> None:
    forcing_basis = ForcingBasis.over(wave, TIMES, cells=5, knots=4)
    assert forcing_basis.shape == (2, 5, 4) and forcing_basis.count == 40
    torch.testing.assert_close(forcing_basis.bumps.sum(dim=0), torch.ones(32).double())
    times = np.array([-1.0, 0.0, 0.33, 1.9, 2.0])
    np.testing.assert_allclose(forcing_basis.hats(times).sum(axis=-1), 1.0)
    values = forcing_basis.at_knots(torch.full((3, 2, 5, 4), 0.7, dtype=torch.float64))
    torch.testing.assert_close(values, torch.full((3, 4, 2, 32), 0.7).double())


@pytest.mark.parametrize(
    ("lengths", "cells", "mesh"),
    [
        ([], 1, ()),
        ([38.0], 12, (12,)),
        ([6.3, 6.3], 4, (4, 4)),
        ([4.0, 1.0], 4, (8, 2)),
        ([1.0, 100.0], 4, (1, 16)),
    ],
)
def test_cells_have_equal_sides(lengths: list[float], cells: int, mesh: tuple[int, ...]) -> None:
    assert square_mesh(lengths, cells) == mesh


def test_a_bump_lies_in_its_cell_and_across_the_ends(wave: System) -> None:
    bumps = ForcingBasis.over(wave, TIMES, cells=8, knots=2).bumps
    x = wave.grid.coordinates["x"]
    tops = x[bumps.argmax(dim=1)]
    assert ((tops - (torch.arange(8) + 0.5) * 10 / 8).abs() <= 10 / 32).all()
    assert float(bumps[0, -1]) > 0.1 and float(bumps[0, 16]) < 1e-3


@pytest.mark.parametrize("text", [WAVE, SWING])
def test_a_driven_run_is_the_simulator_with_a_force_of_time(tmp_path: Path, text: str) -> None:
    """Hats make a force that is linear in time exact."""
    system = laws.declared(tmp_path, text + REST)
    equation = system.fields[-1]
    forcing_basis = ForcingBasis.over(system, TIMES, cells=4 if system.axes else 1, knots=5)
    amplitudes = torch.zeros((2, *forcing_basis.shape), dtype=torch.float64)
    amplitudes[1, -1] = 0.3 - 0.1 * forcing_basis.knots
    start = nominal_start(system)
    both = start.expand(2, *start.shape[1:]).contiguous()
    [terms] = (laws.term(system, equation, "t").terms,)
    run = compile_system(system, terms)
    weights = torch.zeros((2, 1), dtype=torch.float64)
    found = run(both, TIMES, weights, forcing_basis.sampled_forcing(amplitudes))
    listed = (*terms, *laws.term(system, equation, "1").terms)
    forcing = Forcing(listed, torch.tensor([[0.0, 0.0], [-0.1, 0.3]], dtype=torch.float64))
    torch.testing.assert_close(found, simulate(system, both, TIMES, forcing), rtol=1e-9, atol=1e-9)


def test_tangents_are_the_derivative_of_driven_runs(wave: System) -> None:
    forcing_basis = ForcingBasis.over(wave, TIMES, cells=3, knots=3)
    generator = torch.Generator().manual_seed(0)
    amplitudes = 0.3 * torch.randn((1, *forcing_basis.shape), generator=generator).double()
    start = nominal_start(wave)
    terms = laws.term(wave, "u", "u**2").terms
    run, none = compile_system(wave, terms), torch.zeros((1, 1), dtype=torch.float64)
    sampled_forcing = forcing_basis.sampled_forcing(amplitudes)
    states, tangents = zip(
        *tangent_linear(
            wave, start[0], start.new_zeros((0, 2, 32)), TIMES, None, [terms],
            sampled_forcing=sampled_forcing, forcing_basis=forcing_basis,
        ),
        strict=True,
    )  # fmt: skip
    columns = torch.stack(tangents)
    assert columns.shape == (len(TIMES), 1 + forcing_basis.count, 2, 32)
    torch.testing.assert_close(torch.stack(states), run(start, TIMES, none, sampled_forcing)[0])
    h = 1e-5
    for k in range(0, forcing_basis.count, 4):
        step = torch.zeros(forcing_basis.count, dtype=torch.float64)
        step[k] = h
        moved = amplitudes + torch.stack([step, -step]).reshape(2, *forcing_basis.shape)
        twice = start.expand(2, *start.shape[1:]).contiguous()
        ahead, behind = run(twice, TIMES, none.expand(2, 1), forcing_basis.sampled_forcing(moved))
        expected = (ahead - behind) / (2 * h)
        assert float((columns[:, 1 + k] - expected).norm()) < 1e-6 * float(expected.norm())
    ahead, behind = (run(start, TIMES, none + s, sampled_forcing)[0] for s in (h, -h))
    expected = (ahead - behind) / (2 * h)
    assert float((columns[:, 0] - expected).norm()) < 1e-6 * float(expected.norm())


@pytest.mark.parametrize("text", [WAVE, SWING])
def test_what_is_interpreted_is_driven_as_what_is_compiled(tmp_path: Path, text: str) -> None:
    system = laws.declared(tmp_path, text + REST)
    terms = laws.term(system, system.fields[-1], "t").terms
    start, sampled_forcing = driven(system)
    weights = torch.tensor([[0.1], [-0.2]], dtype=torch.float64)
    runs = (made(start, TIMES, weights, sampled_forcing) for made in (
        InterpretedSystem(system, terms), compile_system(system, terms)))  # fmt: skip
    torch.testing.assert_close(*runs, rtol=1e-9, atol=1e-9)


def test_adaptive_steps_are_driven_as_fixed_ones(tmp_path: Path) -> None:
    fixed = laws.declared(tmp_path, SWING + REST)
    adaptive = laws.declared(tmp_path, SWING.replace("rk4", "dopri5") + REST)
    start, sampled_forcing = driven(fixed)
    found = simulate(adaptive, start, TIMES, sampled_forcing=sampled_forcing)
    torch.testing.assert_close(
        found, simulate(fixed, start, TIMES, sampled_forcing=sampled_forcing), rtol=0, atol=1e-6
    )
    assert float((found - simulate(fixed, start, TIMES)).abs().max()) > 0.05


def test_finite_differences_are_driven_as_by_a_force_of_time(tmp_path: Path) -> None:
    text = WAVE.replace("{dt: 0.02}", "{dt: 0.02, space: finite-difference}")
    system = laws.declared(tmp_path, text + REST)
    start = nominal_start(system)
    forcing_basis = ForcingBasis.over(system, TIMES, cells=4, knots=5)
    amplitudes = torch.zeros((1, *forcing_basis.shape), dtype=torch.float64)
    amplitudes[0, 0] = 0.3 - 0.1 * forcing_basis.knots
    listed = tuple(laws.term(system, "u", text).terms[0] for text in ("1", "t"))
    forcing = Forcing(listed, torch.tensor([[0.3, -0.1]], dtype=torch.float64))
    found = simulate(
        system, start, TIMES, sampled_forcing=forcing_basis.sampled_forcing(amplitudes)
    )
    torch.testing.assert_close(found, simulate(system, start, TIMES, forcing), rtol=0, atol=1e-10)


def test_before_the_first_knot_and_after_the_last_a_drive_stays_what_it_is(wave: System) -> None:
    values = torch.arange(3.0).double().reshape(1, 3, 1).expand(2, 3, 2)
    sampled_forcing = SampledForcing(torch.tensor([1.0, 2.0, 4.0]).double(), values)
    for t, expected in ((0.0, 0.0), (1.0, 0.0), (1.25, 0.25), (2.0, 1.0), (3.0, 1.5), (9.0, 2.0)):
        torch.testing.assert_close(sampled_forcing.at(t), torch.full((2, 2), expected).double())
    assert len(sampled_forcing.row(1).values) == 1


def driven(system: System) -> tuple[torch.Tensor, SampledForcing]:
    """Return two starts, and a forcing of each."""
    forcing_basis = ForcingBasis.over(system, TIMES, cells=4 if system.axes else 1, knots=5)
    generator = torch.Generator().manual_seed(1)
    amplitudes = 0.5 * torch.randn((2, *forcing_basis.shape), generator=generator).double()
    start = nominal_start(system)
    return start.expand(2, *start.shape[1:]).contiguous(), forcing_basis.sampled_forcing(amplitudes)
