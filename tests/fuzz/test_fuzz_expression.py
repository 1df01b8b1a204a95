"""Arbitrary texts as expressions: refused with a column, or evaluated correctly."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr, Number
from dashred.physics.expressions.combinations import COMBINATIONS
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.expressions.parser import KNOWN, MAX_LENGTH, Vocabulary, number, parse
from tests.fuzz.examples import fuzzed

LINE = Vocabulary(frozenset({"u", "v", "nu", "x", "t"}), ("x",), "u")
PLANE = Vocabulary(frozenset({"u", "v", "nu", "x", "y", "t"}), ("x", "y"), "u")
POINT = Vocabulary(frozenset({"u", "v", "t"}))

NUMBERS = st.one_of(
    st.integers(0, 12).map(str),
    st.integers(0, 10**400).map(str),
    st.floats(0, allow_nan=False).map(repr),
    st.sampled_from(["1e308", "1e-308", "5e-324", "1e999", "0.", ".5", "0x1F", "1_0", "2j", "pi"]),
)
NAMES = st.sampled_from(["u", "v", "nu", "x", "t", "y", "w", "__class__", "inf", "nan"])
FUNCTION = st.sampled_from(sorted(KNOWN | {"eval", "sum"}))
COMPARISON = st.sampled_from([" > ", ">=", " < ", "<=", "==", " and ", " or ", " in "])
SEVERAL = st.sampled_from(sorted(COMBINATIONS))
SIGNS = st.sampled_from([" + ", "-", "*", "/", "**", "//", "%", "@", "^", "<", " if ", ","])


def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Texts composed of shorter texts, most of them valid."""
    plain = st.sampled_from([" + ", " - ", "*", "/", "**"])
    return st.one_of(
        st.tuples(inner, plain, inner).map("".join),
        st.tuples(inner, SIGNS, inner).map("".join),
        inner.map("-{}".format),
        inner.map("({})".format),
        st.tuples(FUNCTION, inner).map(lambda p: f"{p[0]}({p[1]})"),
        st.tuples(inner, st.integers(0, 9)).map(lambda p: f"d({p[0]}, x, {p[1]})"),
        inner.map("d({}, x)".format),
        st.tuples(inner, COMPARISON, inner).map("".join),
        inner.map("not {}".format),
        st.tuples(SEVERAL, inner, inner).map(lambda p: f"{p[0]}({p[1]}, {p[2]})"),
        st.tuples(SEVERAL, inner, inner, inner).map(lambda p: f"{p[0]}({', '.join(p[1:])})"),
        inner.map("flux({}, x)".format),
        inner.map("u.{}".format),
        inner.map("u[{}]".format),
    )


SENTENCES = st.recursive(NUMBERS | NAMES, grown, max_leaves=12)
# Deeper than the recursion limit, or longer than any line.
TOWERS = st.builds(
    lambda left, times, middle, right: left * times + middle + right * times,
    st.sampled_from(
        ["(", "-", "sin(", "u**", "u+", "lap(", "[", "{", "u if u else ", "not ", "2**"]
    ),
    st.integers(1, 400),
    st.sampled_from(["u", "1", ""]),
    st.sampled_from(["", ")", "]", "}", "**2", "*u"]),
)
TEXTS = st.one_of(SENTENCES, TOWERS, st.text(max_size=60), st.text("u()+-*/.,0e19 dx", max_size=30))


@fuzzed(1000, 90_000, text=TEXTS, vocabulary=st.sampled_from([LINE, PLANE, POINT]))
def test_what_is_read_is_read_again_as_the_same(text: str, vocabulary: Vocabulary) -> None:
    try:
        expr = parse(text, vocabulary, where="a.yaml:1")
    except InputError as error:
        assert error.where == "a.yaml:1"
        return
    assert all(map(math.isfinite, numbers(expr)))
    written = algebra.to_text(expr)
    assume(len(written) <= MAX_LENGTH)
    again = parse(written, vocabulary, where="a.yaml:1")
    assert again == expr and hash(again) == hash(expr)
    assert algebra.to_text(again) == written
    assert algebra.names(expr) <= vocabulary.names


def numbers(expr: Expr) -> list[float]:
    own = [expr.value] if isinstance(expr, Number) else []
    return own + [value for child in algebra.children(expr) for value in numbers(child)]


@fuzzed(200, 10_000, text=TEXTS)
def test_a_number_is_finite(text: str) -> None:
    try:
        value = number(text, where="a.yaml:1")
    except InputError:
        return
    assert isinstance(value, float) and math.isfinite(value)


SMALL = st.recursive(
    st.sampled_from(["u", "v", "t", "2.0", "3.0", "0.5", "1.0", "7.0"]),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from([" + ", " - ", "*", "/", "**"]), inner).map(
            lambda p: f"({''.join(p)})"
        ),
        st.tuples(inner, st.sampled_from(["+", "-", "*", "**"]), inner).map("".join),
        inner.map("-{}".format),
        st.tuples(st.sampled_from(sorted(FUNCTIONS)), inner).map(lambda p: f"{p[0]}({p[1]})"),
        st.tuples(inner, st.sampled_from([">", ">=", "<", "<="]), inner).map(
            lambda p: f"({' '.join(p)})"
        ),
        st.tuples(st.sampled_from(["min", "max", "atan2", "pow"]), inner, inner).map(
            lambda p: f"{p[0]}({p[1]}, {p[2]})"
        ),
        st.tuples(inner, inner, inner).map("clip({0[0]}, {0[1]}, {0[2]})".format),
        st.tuples(inner, inner, inner, inner).map(
            "where({0[0]} > {0[1]} or not {0[2]} > 1, {0[2]}, {0[3]})".format
        ),
    ),
    max_leaves=8,
)
STATES = st.fixed_dictionaries({name: st.floats(-3, 3) for name in ("u", "v", "t")})


def angle_of(y: float, x: float) -> float:
    """Return ``atan2``; no value at its jump, where the sign of a zero would decide."""
    if abs(y) < 1e-9 and x <= 0:
        raise ArithmeticError("a jump")
    return math.atan2(y, x)


SCALARS = {name: function.scalar for name, function in FUNCTIONS.items()} | {
    "min": min,
    "max": max,
    "atan2": angle_of,
    "pow": lambda a, b: a**b,
    "clip": lambda a, low, high: min(max(a, low), high),
    "where": lambda condition, a, b: a if condition else b,
}
NO_VALUE = (ArithmeticError, ValueError, TypeError)


@fuzzed(500, 50_000, text=SMALL, at=STATES)
def test_the_normal_form_has_the_value_of_the_text(text: str, at: dict[str, float]) -> None:
    """Compare with Python's arithmetic, away from overflow and jumps."""
    try:
        wanted = eval(text, {"__builtins__": {}, **SCALARS, **at})
        expr = parse(text, POINT, where="")
        found = value(expr, at)
    except (*NO_VALUE, InputError):
        return
    if isinstance(wanted, bool):
        wanted = float(wanted)
    if isinstance(wanted, complex):  # complex intermediate values may cancel: (-1)**u - (-1)**u
        return
    if not math.isfinite(wanted):  # an overflow: 0*(1/5e-324)
        return
    assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6)


def value(expr: Expr, at: dict[str, float]) -> float:
    """Evaluate a tree; return no value where digits would be lost."""
    match expr:
        case algebra.Number(found):
            pass
        case algebra.Name(id):
            found = at[id]
        case algebra.Sum(terms):
            found = sum(value(term, at) for term in terms)
        case algebra.Product(factors):
            found = math.prod(value(factor, at) for factor in factors)
        case algebra.Power(base, exponent):
            found = value(base, at) ** value(exponent, at)
        case algebra.Call(function, operand):
            inner = value(operand, at)
            if abs(inner) < 1e-9:
                raise ArithmeticError("a jump, or the edge of a domain")
            found = FUNCTIONS[function].scalar(inner)
        case algebra.Where(condition, positive, otherwise):
            inner = value(condition, at)
            if abs(inner) < 1e-9:
                raise ArithmeticError("a jump")
            found = value(positive if inner > 0 else otherwise, at)
        case _:
            raise AssertionError(expr)
    if not isinstance(found, float) or abs(found) > 1e4:
        raise ArithmeticError("large numbers hide small ones")
    return found
