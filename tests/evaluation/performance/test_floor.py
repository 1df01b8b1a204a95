"""The counts of the floor against counts by hand."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from dashred.evaluation.performance.measured.floor import Needs, Scheme, operations
from dashred.evaluation.performance.measured.rates import Rates
from dashred.physics.system import System
from dashred.physics.tangents.semilinear_rhs import forced_semilinear_form
from tests import laws

BURGERS = """
system:
  title: Burgers
  axes: {x: {length: 2*pi, points: 8}}
  fields: {u: velocity}
  equations: {u: "-d(u**2, x) + 0.1*lap(u)"}
  start: {u: sin(x)}
  integrator: {dt: 0.1}
recording: {twin: a, sensors: 2, noise: 0, duration: 1, every: 0.1}
"""
FRONT = """
system:
  title: a front
  axes: {x: {length: 2*pi, points: 8}, y: {length: 2*pi, points: 8}}
  fields: {u: height, v: other}
  equations: {u: GRADIENT - lap(u) - lap(lap(u)), v: lap(v)}
  start: {u: sin(x), v: 0}
  integrator: {dt: 0.1}
recording: {twin: a, sensors: 2, noise: 0, duration: 1, every: 0.1}
"""


def scheme_of(system: System, rows: int = 0) -> Scheme:
    """Return the scheme of a system without a law."""
    return Scheme.of(forced_semilinear_form(system, None), system.grid.shape, rows)


@pytest.fixture
def burgers(tmp_path: Path) -> Scheme:
    """8 points and 5 modes; the input u, the channel u², and its operator d/dx."""
    return scheme_of(laws.declared(tmp_path, BURGERS), rows=2)


def test_a_step_of_the_march(burgers: Scheme) -> None:
    need = burgers.march_step()
    # Each of 4 stages: u to the grid and u² back.
    assert need.transforms64 == 8 and need.transforms32 == 0
    # Each stage: the symbol, the modes of u² and the tendency, and once more the modes of u² where
    # they are transformed; 26 arrays of modes for the sums of the step; u and u² on the grid.
    assert need.bytes == 16 * 5 * (4 * (2 + 1 + 1) + 26) + 8 * 8 * 4 * 2
    # Each stage: a complex product that is added; at each point the square and its sign.
    assert need.operations == 5 * (4 * 8 + 72) + 4 * 8 * 2
    assert need.all_operations(8) == need.operations + 8 * 2.5 * 8 * 3


def test_a_step_of_a_column(burgers: Scheme) -> None:
    need = burgers.column_step()
    assert need.transforms32 == 8 and need.transforms64 == 0
    assert need.bytes == 8 * 5 * (4 * (1 + 1) + 16) + 4 * 8 * 4 * 2
    assert need.operations == 5 * (4 * 8 + 72) + 2 * 4 * 8


def test_a_jacobian_has_one_trajectory_and_its_sources(burgers: Scheme) -> None:
    need = burgers.jacobian(columns=3, steps=10, outputs=2)
    assert need.transforms32 == 3 * (10 * 8 + 2) + 10 * 4 * 2
    assert need.transforms64 == 10 * 8
    march, column = burgers.march_step(), burgers.column_step()
    assert need.bytes == 10 * march.bytes + 30 * column.bytes


def test_the_gradient_on_a_plane_has_two_inputs(tmp_path: Path) -> None:
    text = FRONT.replace("GRADIENT", "-grad2(u)/2")
    scheme = scheme_of(laws.declared(tmp_path, text))
    assert (scheme.inputs, scheme.derived, scheme.channels) == (2, 2, 1)
    assert scheme.slopes == 2 and scheme.modes == 8 * 5
    assert scheme.march_step().transforms64 == 4 * 3


def test_an_equation_without_a_product_needs_no_transform(tmp_path: Path) -> None:
    scheme = scheme_of(laws.declared(tmp_path, FRONT.replace("GRADIENT", "0")))
    assert scheme.march_step().transforms64 == scheme.column_step().transforms32 == 0


@pytest.mark.parametrize(("text", "count"), [("u", 0), ("u*v", 1), ("u*v + sin(u)", 3)])
def test_operations_at_a_point(tmp_path: Path, text: str, count: int) -> None:
    system = laws.declared(tmp_path, FRONT.replace("GRADIENT", "0"))
    assert operations(system.parse(text, "test")) == count


def test_the_floor_is_the_transforms_and_the_slower_of_bytes_and_operations() -> None:
    rates = Rates(transform64=1e-4, transform32=5e-5, bandwidth=1e10, arithmetic=1e9)
    assert Needs(2, 4, 1e6, 5e4).seconds(rates) == pytest.approx(4e-4 + 1e-4)
    assert Needs(0, 0, 1e6, 5e5).seconds(rates) == pytest.approx(5e-4)
    twice = Needs(1, 2, 3, 4).times(2) + Needs(1, 1, 1, 1)
    assert twice == Needs(3, 5, 7, 9)
    assert math.isclose(Needs(transforms32=1).all_operations(16), 2.5 * 16 * 4)
