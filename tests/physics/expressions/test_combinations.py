"""Functions of several numbers and conditions: all backends, derivatives, and their domains."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numba
import numpy as np
import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st

from dashred.physics.backends.numba_backend import ChannelTerm, compile_kernel
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr, Number, Where, substitute
from dashred.physics.expressions.combinations import COMBINATIONS
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.expressions.parser import Vocabulary, number, parse
from dashred.physics.grids.grid import Grid
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.spectral import Spectral
from tests.physics.stack import by_stack

DOCS = Path(__file__).parents[3] / "docs" / "own-system.md"
U, V = "u", "v"
VOCABULARY = Vocabulary(frozenset({U, V}))

# Every function and every sign, with its value in Python.
VALUES: Mapping[str, Callable[[float, float], float]] = {
    "min(u, v)": min,
    "max(u, v)": max,
    "clip(u, -1, v + 10)": lambda u, v: min(max(u, -1.0), v + 10),
    "atan2(u, v)": math.atan2,
    "atan2(u, -2)": lambda u, v: math.atan2(u, -2.0),
    "atan2(0, v)": lambda u, v: 0.0 if v > 0 else math.pi,
    "pow(2, u)": lambda u, v: 2.0**u,
    "where(u > v, u, v**2)": lambda u, v: u if u > v else v * v,
    "where(u > 0 and v > 0, sqrt(u) + sqrt(v), 1)": lambda u, v: (
        math.sqrt(u) + math.sqrt(v) if u > 0 and v > 0 else 1.0
    ),
    "where(u > 0, where(v > 0, log(u*v), log(u)), log(1 - u))": lambda u, v: (
        math.log(u * v if v > 0 else u) if u > 0 else math.log(1 - u)
    ),
    "where(not u > v, u, 3)": lambda u, v: 3.0 if u > v else u,
    "(u >= 1)*v": lambda u, v: (u >= 1) * v,
    "(u <= 1)*v": lambda u, v: (u <= 1) * v,
    "u < v": lambda u, v: float(u < v),
    "-1 < u <= 2": lambda u, v: float(-1 < u <= 2),
    "u > 1 or v > 1 or u < -2": lambda u, v: float(u > 1 or v > 1 or u < -2),
}
EXPRESSIONS = [parse(text, VOCABULARY, where="test") for text in VALUES]
# Where derivatives are tried: off the kinks.
NUMBERS = st.floats(-5, 5).filter(lambda x: abs(x) > 1e-3)


@pytest.fixture(scope="module")
def by_numba() -> Callable[[np.ndarray], np.ndarray]:
    """All expressions at (u, v), in machine code."""
    bodies = [ChannelTerm(i, expr, None) for i, expr in enumerate(EXPRESSIONS)]
    kernel = compile_kernel(bodies, [U, V], [])
    count = len(EXPRESSIONS)

    @numba.njit
    def run(point):
        out = np.empty((count, 1, 1))
        kernel(point.reshape(2, 1, 1), np.zeros((0, 1)), 0.0, np.zeros((1, 0)), out)
        return out[:, 0, 0]

    return run


def by_torch(u: float, v: float) -> list[float]:
    operators = Spectral(Grid(()))
    values = {name: Value(torch.tensor(x, dtype=torch.float64)) for name, x in ((U, u), (V, v))}
    found = Program(EXPRESSIONS)(values, operators)
    return [float(operators.on_grid(value)) for value in found]


@given(u=NUMBERS, v=NUMBERS)
def test_all_backends_agree_with_python(by_numba, u, v):
    """A branch that is not chosen may have no value."""
    assume(abs(u - v) > 1e-3)
    wanted = [value(u, v) for value in VALUES.values()]
    point = {U: np.array([u]), V: np.array([v])}
    np.testing.assert_allclose(Pointwise(EXPRESSIONS)(point, (1,))[:, 0], wanted, rtol=1e-12)
    np.testing.assert_allclose(by_numba(np.array([u, v])), wanted, rtol=1e-12)
    on_stack = by_stack(EXPRESSIONS, {U: 0, V: 1}, [u, v])
    np.testing.assert_allclose(on_stack, wanted, rtol=1e-12)
    np.testing.assert_allclose(by_torch(u, v), wanted, rtol=1e-12)


@pytest.mark.parametrize("name", [U, V])
@pytest.mark.parametrize("text", VALUES)
@given(u=NUMBERS, v=NUMBERS)
def test_the_derivative_is_the_slope(text, name, u, v):
    h = 1e-6
    kinks = (u, v, u - v, u - 1, u + 1, u - 2, u + 2, v - 1, u - v - 10)
    assume(all(abs(kink) > 1e-2 for kink in kinks))
    step = (h, 0.0) if name == U else (0.0, h)
    ahead, behind = (VALUES[text](u + sign * step[0], v + sign * step[1]) for sign in (1, -1))
    slope = at(differentiate(parse(text, VOCABULARY, where="test"), name), u, v)
    assert slope == pytest.approx((ahead - behind) / (2 * h), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("y", [-1.0, 0.0, 2.0])
@pytest.mark.parametrize("x", [-3.0, 0.0, 0.5])
def test_the_angle_of_a_point_on_an_axis(x, y):
    angle = parse("atan2(u, v)", VOCABULARY, where="test")
    assert at(angle, y, x) == pytest.approx(math.atan2(y, x))


def at(expr: Expr, u: float, v: float) -> float:
    return by_stack([expr], {U: 0, V: 1}, [u, v])[0]


def test_a_constant_condition_chooses_its_branch():
    assert number("where(2 > 1, 3, 4)", where="test") == 3.0
    assert number("max(2, 3) + min(2, 3) + clip(7, 0, 1)", where="test") == 6.0
    assert number("atan2(1, -1)", where="test") == pytest.approx(math.atan2(1, -1))
    chosen = parse("where(u > v, 1, 2)", VOCABULARY, where="test")
    assert isinstance(chosen, Where)
    assert substitute(chosen, {U: Number(3.0), V: Number(2.0)}) == Number(1.0)
    assert parse("where(u > v, u, u)", VOCABULARY, where="test") == parse(
        "u", VOCABULARY, where="test"
    )


def test_the_documentation_lists_every_function_of_several_numbers():
    text = DOCS.read_text(encoding="utf-8")
    assert all(f"`{name}(" in text for name in COMBINATIONS)
