"""Derivatives of expressions: against central differences, and of the engine's parameters."""

from __future__ import annotations

import pytest
import torch

from dashred.config import load_config
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Flux, Name, substitute, to_text
from dashred.physics.expressions.differentiate import (
    NotDifferentiableError,
    differentiate,
)
from dashred.physics.expressions.nodes import Number
from dashred.physics.expressions.parser import Vocabulary, number, parse
from dashred.physics.parameter_sensitivity import parameter_tendency
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.system import System

POINTWISE = [
    "a", "3", "b*a**3", "a**b", "b**a", "(1 + a*b)**a", "sin(a*b)", "cos(a**2)", "tan(a)",
    "exp(-a*b)", "log(a + b)", "sqrt(a + b**2)", "tanh(a*b)", "sech(a*b)", "abs(b - 3*a)",
    "sign(a - b)*a", "step(a - 2)*a", "b/(1 + exp(a*(b - 0.5)))", "a*sin(a)*exp(a)",
]  # fmt: skip


def value(expr, **names):
    found = substitute(expr, {name: Number(x) for name, x in names.items()})
    return number(to_text(found), where="test")


@pytest.mark.parametrize("text", POINTWISE)
def test_pointwise_functions(text):
    expr = parse(text, Vocabulary(frozenset({"a", "b"})), where="test")
    slope, a, b, h = differentiate(expr, "a"), 0.7, 1.3, 1e-5
    central = (value(expr, a=a + h, b=b) - value(expr, a=a - h, b=b)) / (2 * h)
    assert value(slope, a=a, b=b) == pytest.approx(central, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(
    "text",
    ["grad2(c*w + w**2)", "lap(w**2*exp(c))", "inv_lap(c*w)", "d(c*w, x)*d(w**c, y)",
     "flux(w**2*c**2, x)", "d(c, x) + w", "grad2(w)"],
)  # fmt: skip
def test_spatial_operators_pass_a_parameter(plane, text):
    vocabulary = Vocabulary(frozenset({"w", "c"}), ("x", "y"), "w")
    expr = parse(text, vocabulary, where="test")
    values = plane.values(nominal_start(plane) + 2, 0.0)

    def evaluated(expr, c):
        [found] = Program([substitute(expr, {"c": Number(c)})])(values, plane.operators)
        points = torch.as_tensor(plane.operators.on_grid(found), dtype=torch.float64)
        return points.expand(1, *plane.grid.shape)

    h = 1e-4
    central = (evaluated(expr, 1.5 + h) - evaluated(expr, 1.5 - h)) / (2 * h)
    torch.testing.assert_close(
        evaluated(differentiate(expr, "c"), 1.5), central, rtol=1e-6, atol=1e-6
    )


def test_a_flux_depends_on_its_field_in_ways_of_its_own():
    with pytest.raises(NotDifferentiableError, match="upwind"):
        differentiate(Flux(Name("u"), "x", "u"), "u")


def engine():
    config = load_config(["conf=rde", "recording.path=x"], entry="train")
    return System(config.system, config.where)


def test_parameters_of_the_engine():
    system = engine()
    for equation, text in {"u": "d(u, x, 2)", "lam": "d(lam, x, 2)"}.items():
        assert parameter_tendency(system, "nu")[equation] == system.parse(text, "test")
    assert list(parameter_tendency(system, "eps")) == ["u"]
    assert list(parameter_tendency(system, "s")) == ["lam"]


@pytest.mark.parametrize("parameter", ["q", "k", "u_c", "alpha", "eps", "s", "u_p", "r", "nu"])
def test_parameter_tendencies_are_the_change_of_the_equations(parameter):
    system, h = engine(), 1e-5
    values = system.values(nominal_start(system), 0.0)

    def tendency(step):
        mine = system.config.parameters[parameter] + step
        words = [f"system.parameters.{parameter}={mine!r}"]
        config = load_config(["conf=rde", "recording.path=x", *words], entry="train")
        changed = System(config.system, config.where)
        found = Program(list(changed.resolved.values()))(values, changed.operators)
        return torch.stack([torch.as_tensor(changed.operators.on_grid(v)) for v in found])

    central = (tendency(h) - tendency(-h)) / (2 * h)
    slopes = parameter_tendency(system, parameter)
    for field, expected in zip(system.fields, central, strict=True):
        if field not in slopes:
            assert not expected.any()
            continue
        [found] = Program([slopes[field]])(values, system.operators)
        points = torch.as_tensor(system.operators.on_grid(found))
        torch.testing.assert_close(points, expected, rtol=1e-6, atol=1e-6)


def test_an_unknown_parameter_is_refused():
    with pytest.raises(KeyError):
        parameter_tendency(engine(), "gamma")
