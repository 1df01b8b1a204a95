"""Sums of products, and the power of a name in a product."""

from __future__ import annotations

import pytest

from dashred.physics.expressions.algebra import Expr, add, to_text
from dashred.physics.expressions.monomials import degree, products
from dashred.physics.system import System
from tests.evaluation.foreign.invented import DECAY, system_of


@pytest.fixture(scope="module")
def system() -> System:
    return system_of(DECAY)


def parsed(system: System, text: str) -> Expr:
    return system.resolve(system.parse(text, "term", equation="x"), "term")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x", 1),
        ("3*x*y**2", 1),
        ("-x**3/y", 3),
        ("y/x**2", -2),
        ("y", 0),
        ("sin(y)", 0),
        ("sin(x)", None),
        ("x + y", None),
        ("x**2*exp(x)", None),
        ("x**0.5", None),
    ],
)
def test_the_degree_of_a_product_in_x(system: System, text: str, expected: int | None) -> None:
    assert degree(parsed(system, text), "x") == expected


@pytest.mark.parametrize("text", ["2*(x - y)", "x*(28 - y)", "(x + y)*(x - 2*y)", "x*y"])
def test_a_sum_of_products_is_the_same_function(system: System, text: str) -> None:
    expr = parsed(system, text)
    found = products(expr)
    assert all(degree(product, "x") is not None for product in found)
    values = {"x": 1.7, "y": -0.6}
    whole, sum_of_products = (eval(to_text(each), {}, dict(values)) for each in (expr, add(found)))
    assert sum_of_products == pytest.approx(whole, rel=1e-12)
