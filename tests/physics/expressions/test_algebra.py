"""The normal form: equal expressions are equal objects, and text says all of one."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Name, Number, substitute, to_text
from dashred.physics.expressions.parser import MAX_ORDER, Vocabulary, parse

LINE = Vocabulary(frozenset({"u", "v", "a", "x", "t"}), ("x",), "u")
PLANE = Vocabulary(frozenset({"u", "v", "a", "x", "y", "t"}), ("x", "y"), "u")


def read(text, vocabulary=LINE):
    return parse(text, vocabulary, where="test")


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("u*v", "v*u"),
        ("u + v", "v + u"),
        ("u + (v + a)", "(a + u) + v"),
        ("u*u**2", "u**3"),
        ("u*v*u", "u**2*v"),
        ("u**2/u", "u"),
        ("u**3/u**3", "1"),
        ("u**2*u**-3", "1/u"),
        ("2*u + 3*u", "5*u"),
        ("u - u", "0"),
        ("0*u + v", "v"),
        ("u/2", "0.5*u"),
        ("1/(2*u)", "0.5/u"),
        ("(2*u)**2", "4*u**2"),
        ("(-u)**2", "u**2"),
        ("(u*v)**3", "v**3*u**3"),
        ("2*(u + v)*a", "a*(u + v)*2"),
        ("-(u + v) + u", "-v"),
        ("2*(u + v) + a", "2*v + a + 2*u"),
        ("1e-3*u", "0.001*u"),
        ("+u - -v", "u + v"),
        ("lap(u)", "d(u, x, 2)"),
        ("d(d(u, x), x, 2)", "d(u, x, 3)"),
        ("d(-3*u, x)", "-3*d(u, x)"),
        ("grad2(u)", "d(u, x)**2"),
        ("grad2(-2*u)", "4*d(u, x)**2"),
        ("d(2, x)", "0"),
        ("lap(2 + 3)", "0"),
        ("exp(0)*u", "u"),
        ("u**0.5*2*u**0.5", "2*u**0.5*u**0.5"),
    ],
)
def test_what_means_the_same_is_the_same(left, right):
    assert read(left) == read(right)
    assert hash(read(left)) == hash(read(right))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("u**2", "u*v"),
        ("(u**2)**0.5", "u"),
        ("d(u*v, x)", "u*d(v, x)"),
        ("sin(2*u)", "2*sin(u)"),
        ("u**-1", "u"),
        ("abs(-u)", "-abs(u)"),
    ],
)
def test_what_means_something_else_differs(left, right):
    assert read(left) != read(right)


def test_mixed_derivatives_commute_in_the_plane():
    assert read("d(d(u, y), x)", PLANE) == read("d(d(u, x), y)", PLANE)
    assert read("d(d(d(u, x), y), x)", PLANE) == read("d(d(u, x, 2), y)", PLANE)
    assert read("lap(-2*u)", PLANE) == read("-2*lap(u)", PLANE)
    assert read("grad2(-2*u)", PLANE) == read("4*grad2(u)", PLANE)


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("v*u*2.50", "2.5*u*v"),
        ("-1*u", "-u"),
        ("u-(v-1)", "1 + u - v"),
        ("-(u + v)*a", "-a*(u + v)"),
        ("u**-1", "u**(-1)"),
        ("lap(lap(u))", "d(u, x, 4)"),
        ("d(u*u/2, x)", "0.5*d(u**2, x)"),
        ("(u+v)**2", "(u + v)**2"),
        ("1e20*u", "1e+20*u"),
    ],
)
def test_text_is_plain(text, written):
    assert to_text(read(text)) == written


def test_a_substitution_gives_the_normal_form():
    values = {"a": Number(2.0), "v": read("3*d(u, x)")}
    assert substitute(read("a*u*a"), values) == read("4*u")
    assert substitute(read("d(v, x)"), values) == read("3*d(u, x, 2)")
    assert substitute(read("exp(a)*u"), values) == read("exp(2)*u")
    assert substitute(read("d(a, x) + u"), values) == read("u")
    assert substitute(read("a*(u + v)"), {"v": read("u")}) == read("2*a*u")


@pytest.mark.parametrize("text", ["1/(a - 2)", "log(a - 3)", "(a - 4)**0.5", "exp(a*500)"])
def test_a_substitution_refuses_what_is_no_real_number(text):
    with pytest.raises((ArithmeticError, ValueError)):
        substitute(read(text), {"a": Number(2.0)})


def test_numbers_that_overflow_are_refused():
    with pytest.raises(ArithmeticError):
        algebra.scale(1e200, algebra.scale(1e200, Name("u")))
    with pytest.raises(ArithmeticError):
        algebra.add((algebra.scale(1.7e308, Name("u")), algebra.scale(1.7e308, Name("u"))))


def test_the_names_that_an_expression_reads():
    assert algebra.names(read("d(u*v, x) + exp(a)")) == {"u", "v", "a"}


numbers = st.one_of(
    st.integers(-9, 9).map(float),
    st.floats(min_value=1e-3, max_value=1e3, allow_nan=False).map(lambda x: float(f"{x:.3g}")),
    st.floats(min_value=-10, max_value=10, allow_nan=False),
).map(Number)
leaves = st.one_of(numbers, st.sampled_from(["u", "v", "a", "t"]).map(Name))


def guarded(build):
    """Apply a constructor to its operands, or keep the first where a number overflows."""

    def built(operands):
        try:
            return build(*operands)
        except (ArithmeticError, ValueError):
            return operands[0]

    return built


def grow(inner):
    whole = st.integers(-3, 4).map(lambda n: Number(float(n)))
    axis = st.sampled_from("xy")
    return st.one_of(
        st.tuples(inner, inner).map(guarded(lambda *pair: algebra.add(pair))),
        st.tuples(inner, inner).map(guarded(lambda *pair: algebra.multiply(pair))),
        st.tuples(inner, whole | inner).map(guarded(algebra.power)),
        st.tuples(inner, st.sampled_from(["sin", "tanh", "sign", "lap", "inv_lap", "grad2"])).map(
            guarded(lambda operand, function: algebra.call(function, operand))
        ),
        st.tuples(inner, axis, st.integers(1, 2)).map(guarded(algebra.derivative)),
        st.tuples(inner, axis).map(lambda pair: algebra.Flux(*pair, "u")),
    )


def order(expr):
    own = expr.order if isinstance(expr, algebra.Derivative) else 0
    return max([own, *map(order, algebra.children(expr))])


@settings(max_examples=250)
@given(st.recursive(leaves, grow, max_leaves=8).filter(lambda expr: order(expr) <= MAX_ORDER))
def test_reading_what_was_written_gives_the_same_tree(expr):
    assert read(to_text(expr), PLANE) == expr
