"""Compiled runs with terms in windows, each row's own, against :func:`simulate`."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.physics.expressions.algebra import multiply
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.batch_coefficients import CoefficientLayout
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.compiled.runge_kutta import CompiledRungeKutta
from dashred.physics.solvers.compiled_simulator import (
    DeviceSystem,
    InterpretedSystem,
    compile_system,
)
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.window import Window, box, gate, onset, window_shapes
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
  integrator: {dt: 0.05}
"""
SWING = """
system:
  title: a swing
  fields: {x: place, p: momentum}
  equations: {x: p, p: -2*sin(x)}
  start: {x: 1, p: 0}
  integrator: {method: rk4, dt: 0.05}
"""
TERMS = (("u", "u"), ("u", "u**3"), ("v", "u*v"), ("u", "lap(u)"), ("v", "d(v, x)"), ("u", "1"))
FORCES = (("p", "p"), ("p", "x**3"), ("x", "1"))
TIMES = torch.tensor([0.0, 0.3, 1.0, 1.7], dtype=torch.float64)


def rows(windows: list[Window], terms: int) -> tuple[Tensor, Tensor]:
    """Return coefficients everywhere and inside: of each row others, some of them zero."""
    generator = torch.Generator().manual_seed(1)
    everywhere, inside = 0.4 * torch.rand((2, len(windows), terms), generator=generator) - 0.2
    everywhere[:, ::2], inside[1:2, 1:] = 0.0, 0.0
    return everywhere.double(), inside.double()


def reference(
    system: System, terms: tuple[Term, ...], windows: list[Window], start: Tensor
) -> Tensor:
    everywhere, inside = rows(windows, len(terms))
    found = []
    for row, window in enumerate(windows):
        chi = window.expression
        local = tuple(Term(t.equation, multiply((t.expression, chi))) for t in terms)
        weights = torch.cat([everywhere[row], inside[row]])[None]
        found.append(simulate(system, start, TIMES, Forcing((*terms, *local), weights)))
    return torch.cat(found)


def compare(system: System, listed: tuple[tuple[str, str], ...], windows: list[Window]) -> object:
    terms = tuple(laws.term(system, equation, text).terms[0] for equation, text in listed)
    shapes = window_shapes(system)
    run = compile_system(system, terms, shapes)
    columns = CoefficientLayout(len(terms), shapes)
    start = nominal_start(system)
    many = start.expand(len(windows), *start.shape[1:]).contiguous()
    weights = columns.weights(*rows(windows, len(terms)), windows)
    assert weights.shape == (len(windows), columns.count)
    found = run(many, TIMES, weights)
    expected = reference(system, terms, windows, start)
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-9)
    bare = simulate(system, start, TIMES)
    assert ((found - bare).abs().flatten(1).amax(dim=1) > 1e-3).all()
    # A row without a window has its terms everywhere alone.
    plain = torch.zeros_like(weights[:1])
    plain[:, 0] = -0.1
    forcing = Forcing(terms[:1], torch.tensor([[-0.1]], dtype=torch.float64))
    torch.testing.assert_close(
        run(start, TIMES, plain), simulate(system, start, TIMES, forcing), rtol=1e-9, atol=1e-9
    )
    return run


def test_boxes_gates_and_onsets_on_a_ring(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, WAVE + REST)
    windows = [
        box(system.axes[0]).at((9.0, 2.0, math.log(0.4))),
        box(system.axes[0]).at((4.0, 1.0, math.log(0.8))),
        onset().at((0.8, math.log(0.2))),
        gate("u", 1).at((0.3, math.log(0.2))),
        gate("v", -1).at((0.1, math.log(0.1))),
    ]
    assert isinstance(compare(system, TERMS, windows), CompiledETDRK4)


def test_an_ode_has_onsets_and_gates(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, SWING + REST)
    windows = [onset().at((0.8, math.log(0.2))), gate("p", -1).at((0.1, math.log(0.1)))]
    assert isinstance(compare(system, FORCES, windows), CompiledRungeKutta)
    assert {shape.kind for shape in window_shapes(system)} == {"onset", "gate above", "gate below"}


@pytest.mark.parametrize("space", ["spectral", "finite-difference"])
def test_what_cannot_be_compiled_has_them_too(tmp_path: Path, space: str) -> None:
    text = WAVE.replace("dt: 0.05", f"dt: 0.05, space: {space}")
    if space == "spectral":
        text = text.replace("u - u**3/3", "u - u**3/3 + 0.02*u*lap(u**2)")
    system = laws.declared(tmp_path, text + REST)
    windows = [box(system.axes[0]).at((9.0, 2.0, math.log(0.4)))]
    assert isinstance(compare(system, TERMS[:2], windows), InterpretedSystem)


def test_on_a_device_rows_with_a_window_are_integrated_apart(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, WAVE + REST)
    terms = tuple(laws.term(system, equation, text).terms[0] for equation, text in TERMS[:2])
    shapes = window_shapes(system)
    windows = [box(system.axes[0]).at((9.0, 2.0, math.log(0.4)))]
    layout = CoefficientLayout(len(terms), shapes)
    weights = layout.weights(*rows(windows, len(terms)), windows).repeat(3, 1)
    weights[1, len(terms) :] = 0
    start = nominal_start(system).repeat(3, 1, 1)
    run, expected = DeviceSystem(system, terms, shapes), InterpretedSystem(system, terms, shapes)
    # Not compiled, to be quick.
    vars(run)["_windowed"] = expected
    found = run(start, TIMES, weights)
    torch.testing.assert_close(found, expected(start, TIMES, weights), rtol=1e-11, atol=1e-11)
    assert (found[0] - found[1]).abs().amax() > 1e-3
    assert run.with_step(0.01).system.dt == 0.01
