"""A tendency written in Python becomes the equations that it computes, or is refused."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
import torch

from dashred.config import Axis, Integrator
from dashred.config import System as Declared
from dashred.physics.black_box.tracing import first_mismatch, trace
from dashred.physics.black_box.tracing_values import NotTraceableError
from dashred.physics.system import System

Rule = Callable[[Any, Any, Any, Any], Any]


class Written:
    """A class with one rule for the field u, as a user would write it."""

    def __init__(self, rule: Rule) -> None:
        """Hold the rule."""
        self.rule = rule

    def tendency(self, fields: Any, t: Any, parameters: Any, space: Any) -> Mapping[str, Any]:
        """Return the tendency of u."""
        return {"u": self.rule(fields["u"], t, parameters, space)}


def declared(axes: tuple[str, ...] = (), equation: str | None = None) -> System:
    method = None if axes else "rk4"
    integrator = Integrator(method, 0.1, False, "spectral", 1e-9, 1e-9)
    grid = {name: Axis(2 * np.pi, 16) for name in axes}
    equations = {} if equation is None else {"u": equation}
    config = Declared(
        title="T", axes=grid, fields={"u": "a field"}, parameters={"a": 0.5, "b": 2.0},
        equations=equations, start={"u": 0}, integrator=integrator,
    )  # fmt: skip
    return System(config, lambda key: key)


POINTWISE: dict[str, tuple[Rule, str]] = {
    "arithmetic": (lambda u, t, p, s: -p["a"] * u + u**3 / p["b"] - 1, "-a*u + u**3/b - 1"),
    "right hand": (lambda u, t, p, s: 1 / (2 - 3 * u) + 2**u, "1/(2 - 3*u) + 2**u"),
    "functions": (lambda u, t, p, s: torch.sin(u) + u.tanh() + abs(u), "sin(u) + tanh(u) + abs(u)"),
    "special": (
        lambda u, t, p, s: torch.erf(u) + u.cosh() + u.arctan(),
        "atan(u) + cosh(u) + erf(u)",
    ),
    "time": (lambda u, t, p, s: torch.cos(p["b"] * t) * u, "cos(b*t)*u"),
    "constants": (lambda u, t, p, s: torch.tensor(2.0) * u - np.float64(0.5), "2*u - 0.5"),
    "in torch": (lambda u, t, p, s: torch.mul(u, torch.square(u)).neg(), "-u**3"),
    "a number": (lambda u, t, p, s: 1.5, "1.5"),
}


@pytest.mark.parametrize("case", POINTWISE)
def test_what_is_computed_is_written_down(case: str) -> None:
    rule, equation = POINTWISE[case]
    found = trace(Written(rule), declared())
    assert declared(equation=found["u"]).equations == declared(equation=equation).equations
    assert first_mismatch(Written(rule), declared(equation=found["u"])) is None


@pytest.mark.parametrize("axes", [("x",), ("x", "y")])
def test_space_is_written_down(axes: tuple[str, ...]) -> None:
    def rule(u: Any, t: Any, p: Any, s: Any) -> Any:
        return -s.d(u**2 / 2, "x") + p["a"] * s.lap(u) + s.grad2(u) * torch.sin(s.coordinate("x"))

    found = trace(Written(rule), declared(axes))
    expected = "-d(u**2/2, x) + a*lap(u) + grad2(u)*sin(x)"
    assert declared(axes, found["u"]).equations == declared(axes, expected).equations
    assert first_mismatch(Written(rule), declared(axes, found["u"])) is None


REFUSED: dict[str, tuple[Rule, str]] = {
    "branch": (lambda u, t, p, s: -u if u else u, "a decision"),
    "comparison": (lambda u, t, p, s: torch.where(u > 0, u, -u), "a comparison"),
    "number": (lambda u, t, p, s: float(u), "a conversion of the state to a number"),
    "function": (lambda u, t, p, s: torch.lgamma(u), "the function lgamma"),
    "matrix": (lambda u, t, p, s: torch.ones(3, dtype=torch.float64) * u, "a Tensor together"),
    "mean": (lambda u, t, p, s: u - u.mean(dim=0), "the function mean with dim="),
    "axis": (lambda u, t, p, s: s.d(u, "x"), "an unknown axis"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_equation_says_is_refused(case: str) -> None:
    rule, message = REFUSED[case]
    with pytest.raises(NotTraceableError, match=message):
        trace(Written(rule), declared())


def test_a_class_that_computes_another_thing_with_numbers_is_found_out() -> None:
    def rule(u: Any, t: Any, p: Any, s: Any) -> Any:
        return -u * 2 if isinstance(u, torch.Tensor) else -u

    found = trace(Written(rule), declared())
    assert first_mismatch(Written(rule), declared(equation=found["u"])) == "u"
