"""Lookup in a table: the values of numpy.interp, in expressions, derivatives and simulations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.expressions.parser import Vocabulary, parse
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate
from tests import laws

CURVE = ((0.0, 3.0), (0.5, 3.7), (0.6, 3.5), (2.0, 4.1))
VOCABULARY = Vocabulary(frozenset({"u"}), tables={"OCV": CURVE})
TANK = """
system:
  title: a tank whose outflow was measured
  fields: {h: level}
  tables: {OUT: {x: [0, 0.5, 1.0], y: [0, 0.4, 0.5]}}
  let: {outflow: "interp(h, OUT)"}
  equations: {h: 0.1 - outflow}
  start: {h: 0.9}
  integrator: {method: rk4, dt: 0.01}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""
ROD = """
system:
  title: a rod of two materials
  axes: {x: {length: 4, points: 32}}
  fields: {u: temperature}
  tables: {LOSS: {x: [0, 1, 3, 4], y: [0.1, 0.1, 0.5, 0.5]}}
  equations: {u: "-interp(x, LOSS)*u"}
  start: {u: 2}
  integrator: {dt: 0.02}
recording: {twin: a, sensors: 2, noise: 0, duration: 4, every: 0.1}
"""


@st.composite
def tables(draw: st.DrawFn) -> tuple[tuple[float, float], ...]:
    x = sorted(draw(st.sets(st.integers(-50, 50), min_size=2, max_size=12)))
    y = draw(st.lists(st.floats(-10, 10), min_size=len(x), max_size=len(x)))
    return tuple((0.1 * a, b) for a, b in zip(x, y, strict=True))


@settings(max_examples=60, deadline=None)
@given(points=tables(), u=st.lists(st.floats(-20, 20), min_size=1, max_size=8))
def test_it_is_the_piecewise_linear_function(
    points: tuple[tuple[float, float], ...], u: list[float]
) -> None:
    expr = parse("interp(u, T)", Vocabulary(frozenset({"u"}), tables={"T": points}), where="test")
    x, y = np.array(points).T
    values = np.array([*u, *x])
    found = Pointwise([expr])({"u": values}, values.shape)[0]
    np.testing.assert_allclose(found, np.interp(values, x, y), atol=1e-10 * (1 + np.abs(y).max()))


def test_its_derivative_is_the_slope() -> None:
    expr = differentiate(parse("interp(2*u, OCV)", VOCABULARY, where="test"), "u")
    values = np.array([-0.1, 0.1, 0.28, 0.7, 1.2])
    found = Pointwise([expr])({"u": values}, values.shape)[0]
    np.testing.assert_allclose(found, [0, 2.8, -4, 2 * 0.6 / 1.4, 0], atol=1e-12)


def test_a_tank_follows_its_measured_outflow(tmp_path: Path) -> None:
    """Between two points the equation is linear: the level decays exponentially."""
    system = laws.declared(tmp_path, TANK)
    times = torch.linspace(0, 4, 41, dtype=torch.float64)
    found = simulate(system, nominal_start(system), times)[0, :, 0]
    # Above 0.5 the outflow is 0.3 + 0.2 h, below it is 0.8 h.
    upper = -1.0 + 1.9 * torch.exp(-0.2 * times)
    crossing = float(np.log(1.9 / 1.5) / 0.2)
    lower = 0.125 + 0.375 * torch.exp(-0.8 * (times - crossing))
    expected = torch.where(times < crossing, upper, lower)
    torch.testing.assert_close(found, expected, atol=1e-4, rtol=0)


def test_a_coefficient_along_an_axis(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, ROD)
    found = simulate(system, nominal_start(system), torch.tensor([0.0, 1.0]).double())[0, 1, 0]
    x = np.linspace(0, 4, 32, endpoint=False)
    expected = 2 * np.exp(-np.interp(x, [0, 1, 3, 4], [0.1, 0.1, 0.5, 0.5]))
    # The products are band-limited, and the loss jumps at the seam.
    middle = slice(6, 26)
    np.testing.assert_allclose(found.numpy()[middle], expected[middle], rtol=0.03)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("interp(u, OVC)", "'OVC' is not a table"),
        ("interp(u, 3)", "'3' is not a table"),
        ("interp(u)", "takes 2 arguments, not 1"),
        ("OCV*u", "'OCV' is a table: write interp"),
        ("interp(OCV, OCV)", "'OCV' is a table"),
    ],
)
def test_bad_lookups(text: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        parse(text, VOCABULARY, where="test")


@pytest.mark.parametrize(
    ("table", "what"),
    [
        ("{x: [0, 1], y: [1]}", "2 values of x and 1 of y"),
        ("{x: [0], y: [1]}", "has 1 points; it needs 2 to 200"),
        ("{x: [0, 1, 1], y: [1, 2, 3]}", "must increase; 1 follows 1"),
        ("{x: [0, .inf], y: [1, 2]}", r"system.tables.OUT.x\[1\] must be a number"),
        ("{x: [0, 1]}", "missing: system.tables.OUT.y"),
        ("{x: [0, a], y: [1, 2]}", r"system.tables.OUT.x\[1\] must be a number"),
        ("{x: [0, 1], y: [1, 2], z: 3}", "unknown key system.tables.OUT.z"),
        ("3", "system.tables.OUT must be a section of keys"),
    ],
)
def test_bad_tables(tmp_path: Path, table: str, what: str) -> None:
    text = TANK.replace("{x: [0, 0.5, 1.0], y: [0, 0.4, 0.5]}", table)
    with pytest.raises(InputError, match=what):
        laws.declared(tmp_path, text)


def test_a_table_needs_a_name_of_its_own(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the name 'OUT' is also used"):
        laws.declared(tmp_path, TANK.replace("outflow", "OUT"))
