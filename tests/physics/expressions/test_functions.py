"""Every function of the table: all backends, its derivative, its parity, its domain, its docs."""

from __future__ import annotations

import math
from pathlib import Path

import numba
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dashred.physics.backends.numba_backend import ChannelTerm, compile_kernel
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.expressions.algebra import Call, Name, Number, substitute
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.expressions.functions import FUNCTIONS, Function, Parity
from dashred.physics.expressions.parser import number
from tests.physics.stack import by_stack

DOCS = Path(__file__).parents[3] / "docs"
NAMES = list(FUNCTIONS)
CALLS = [Call(name, Name("x")) for name in NAMES]
# Where derivatives are tried: far from kinks at 0 and from poles of the tangent.
SMOOTH = st.floats(0.05, 1.4) | st.floats(-1.4, -0.05)
every = pytest.mark.parametrize("function", FUNCTIONS.values(), ids=NAMES)


def scalar(function: Function, x: float) -> float | None:
    """Return the value; None outside of the domain."""
    try:
        return function.scalar(x)
    except (ArithmeticError, ValueError):
        return None


@pytest.fixture(scope="module")
def by_numba():
    """All functions of numbers ``(point,)``, ``(function, point)``, in machine code."""
    bodies = [ChannelTerm(i, call, None) for i, call in enumerate(CALLS)]
    kernel = compile_kernel(bodies, ["x"], [])
    count = len(CALLS)

    @numba.njit
    def run(x):
        out = np.empty((count, 1, x.size))
        kernel(x.reshape(1, 1, -1), np.zeros((0, x.size)), 0.0, np.zeros((1, 0)), out)
        return out[:, 0]

    return run


@given(x=st.floats(-30, 30))
def test_all_backends_agree_with_the_scalar_function(by_numba, x):
    """Where a scalar has no value, arrays hold what is not finite."""
    point = np.array([x])
    machine = by_numba(point)[:, 0]
    on_stack = by_stack(CALLS, {"x": 0}, [x])
    arrays = Pointwise(CALLS)({"x": point}, (1,))[:, 0]
    for call, in_numba, in_stack, in_numpy in zip(CALLS, machine, on_stack, arrays, strict=True):
        function = FUNCTIONS[call.function]
        wanted = scalar(function, x)
        in_torch = function.arrays(torch)(torch.tensor([x], dtype=torch.float64))
        assert in_torch.dtype == torch.float64
        if wanted is None:
            found = (in_numba, in_stack, in_numpy, in_torch.item())
            assert not any(map(math.isfinite, found)), call
            continue
        for value in (in_numba, in_stack, in_numpy, in_torch.item()):
            assert value == pytest.approx(wanted, rel=1e-12, abs=1e-300), call


@every
@given(x=SMOOTH)
def test_the_derivative_is_the_slope_of_the_function(function, x):
    h = 1e-5
    ahead, behind = scalar(function, x + h), scalar(function, x - h)
    if ahead is None or behind is None:
        return
    slope = substitute(differentiate(Call(function.name, Name("u")), "u"), {"u": Number(x)})
    assert isinstance(slope, Number)
    assert slope.value == pytest.approx((ahead - behind) / (2 * h), rel=1e-6, abs=1e-8)


@every
def test_the_parity_is_the_symmetry_of_the_function(function):
    at = [0.05, 0.3, 1.0, 1.4]
    pairs = [(scalar(function, x), scalar(function, -x)) for x in at]
    even = all(ahead == behind for ahead, behind in pairs)
    odd = all(behind is not None and ahead == -behind for ahead, behind in pairs)
    found = Parity.EVEN if even else Parity.ODD if odd else Parity.NEITHER
    assert function.parity is found


@pytest.mark.parametrize("name", [name for name in NAMES if FUNCTIONS[name].unit_power])
def test_a_function_of_a_quantity_scales_with_its_unit(name):
    """``f(c x) = cⁿ f(x)``, with n the power of the unit."""
    function = FUNCTIONS[name]
    scaled = 4.0**function.unit_power * function.scalar(0.7)
    assert function.scalar(4.0 * 0.7) == pytest.approx(scaled)


@every
def test_the_language_knows_it(function):
    assert number(f"{function.name}(0.7)", where="test") == function.scalar(0.7)


def test_the_documentation_lists_every_function():
    assert f"`{' '.join(FUNCTIONS)}`" in (DOCS / "own-system.md").read_text(encoding="utf-8")
