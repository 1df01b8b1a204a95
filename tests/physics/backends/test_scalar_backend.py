"""Expressions of plain numbers, against the same of arrays."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.backends.scalar_backend import NON_FINITE_ERRORS, scalar_program
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.system import System
from tests import laws

NAMES = ("u", "t")


@pytest.fixture
def system(tmp_path: Path) -> System:
    return laws.declared(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        *(f"{name}(1.5 + u/4)" for name in FUNCTIONS),
        "u*sin(t) - 2*u**3 + u/(t + 4)",
        "(2 + u)**2.5*t",
    ],
)
def test_numbers_are_those_of_arrays(system: System, text: str) -> None:
    expressions = [system.parse(text, "test"), system.parse("3 - u", "test")]
    program, arrays = scalar_program(expressions, NAMES), Pointwise(expressions)
    for u, t in np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2)):
        expected = arrays({"u": np.array([u]), "t": np.array([t])}, (1,))[:, 0]
        np.testing.assert_allclose(program(float(u), float(t)), expected, rtol=1e-13, atol=1e-15)


def test_what_grows_without_bound_is_infinite_as_in_arrays(system: System) -> None:
    expressions = [system.parse(text, "test") for text in ("sech(1000*u)", "1/(1 + exp(1000*u))")]
    assert scalar_program(expressions, ("u",))(1.0) == (0.0, 0.0)
    assert scalar_program([system.parse("exp(1000*u)", "test")], ("u",))(1.0) == (math.inf,)


@pytest.mark.parametrize(("text", "u"), [("1/u", 0.0), ("log(u)", -1.0), ("sin(u**0.5)", -1.0)])
def test_what_is_no_number_is_told(system: System, text: str, u: float) -> None:
    with pytest.raises(NON_FINITE_ERRORS):
        scalar_program([system.parse(text, "test")], ("u",))(u)
