"""The parser: what it reads, and everything that it refuses, with the column pointed at."""

from __future__ import annotations

import math
import re
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.physics.expressions import algebra
from dashred.physics.expressions.parser import KNOWN, Vocabulary, number, parse

LINE = Vocabulary(frozenset({"u", "lam", "alpha", "x", "t"}), ("x",), "u")
ODE = Vocabulary(frozenset({"theta", "omega", "t"}))


def refused(text, vocabulary=LINE):
    with pytest.raises(InputError) as caught:
        parse(text, vocabulary, where="rde.yaml:7")
    assert caught.value.where == "rde.yaml:7"
    return caught.value


def column(error):
    """The column named in words; the mark below the text must stand under the same character."""
    found = re.search(r"\(column (\d+)\)", error.what)
    assert found, error.what
    _, shown, mark = error.what.splitlines()
    if len(shown) < 42:
        assert mark.index("^") - 2 == int(found[1]) - 1
    return int(found[1])


@pytest.mark.parametrize(
    ("text", "at", "says"),
    [
        ("u.real", 1, "not part of the equation language"),
        ("u + u.__class__", 5, "not part of the equation language"),
        ("__import__('os')", 1, "unknown function '__import__'"),
        ("u*__import__('os').system('ls')", 3, "not part of the equation language"),
        ("eval('1')", 1, "unknown function 'eval'"),
        ("u + lambda: 1", 5, "'lambda' is a Python keyword"),
        ("u if x else 1", 3, "'if' is a Python keyword"),
        ("True*u", 1, "'True' is a Python keyword"),
        ("u*None", 3, "'None' is a Python keyword"),
        ("'text'", 1, "only real numbers"),
        ("u + b'x'", 5, "only real numbers"),
        ("f'{u}'", 1, "not part of the equation language"),
        ("2j*u", 1, "only real numbers"),
        ("u*...", 3, "not part of the equation language"),
        ("u == x", 1, "a comparison is written with >, >=, < or <="),
        ("u in x", 3, "'in' is a Python keyword"),
        ("u if x > 0 else 1", 3, "'if' is a Python keyword"),
        ("where(u, 1, 2)", 7, "this is not a condition"),
        ("not u", 5, "this is not a condition"),
        ("u > 0 and x", 11, "this is not a condition"),
        ("where(u > 0, 1)", 1, "where() takes 3 arguments, not 2"),
        ("min(u)", 1, "min() takes 2 arguments, not 1"),
        ("u[0]", 1, "not part of the equation language"),
        ("[u]", 1, "not part of the equation language"),
        ("{u}", 1, "not part of the equation language"),
        ("(u, x)", 1, "not part of the equation language"),
        ("exp(*u)", 5, "not part of the equation language"),
        ("exp(u, base=2)", 1, "not part of the equation language"),
        ("(u := 2)", 2, "not part of the equation language"),
        ("u % 2", 1, "operator is not part"),
        ("u // 2", 1, "operator is not part"),
        ("u @ x", 1, "operator is not part"),
        ("~u", 1, "not part of the equation language"),
        ("u(2)", 1, "unknown function 'u'"),
        ("exp(u)(x)", 1, "not part of the equation language"),
        ("u^2", 2, "powers are written **, not ^"),
        ("lap(u) + lmbda", 10, "unknown name 'lmbda'"),
        ("2*exo(u)", 3, "unknown function 'exo'"),
        ("sin + u", 1, "'sin' is a function"),
        ("sin(u, x)", 1, "sin() takes 1 argument, not 2"),
        ("1 + d(u)", 5, "d() takes 2 or 3 arguments, not 1"),
        ("flux(u)", 1, "flux() takes 2 arguments"),
        ("exp()", 1, "exp() takes 1 argument, not 0"),
        ("d(u, y)", 6, "'y' is not an axis"),
        ("d(u, 2)", 6, "'2' is not an axis"),
        ("d(u, x, 0)", 9, "whole number from 1 to 8"),
        ("d(u, x, 1.5)", 9, "whole number from 1 to 8"),
        ("d(u, x, 9)", 9, "whole number from 1 to 8"),
        ("d(u, x, -1)", 9, "whole number from 1 to 8"),
        ("1 + d(d(u, x, 8), x)", 5, "order 9 is above 8"),
        ("u + 9**9**9", 5, "not a finite real number"),
        ("u*1e400", 3, "not a finite real number"),
        ("1e300*u*1e300", 1, "not a finite real number"),
        ("u/0", 1, "not a finite real number"),
        ("u**1e308*u**1e308", 1, "not a finite real number"),
        ("u + 1/(2 - 2)", 5, "not a finite real number"),
        ("(-8)**(1/3)", 1, "not a finite real number"),
        ("u*log(-1)", 3, "not a finite real number"),
        ("exp(1000)", 1, "not a finite real number"),
        ("u + λ", 5, "plain ASCII"),
        ("u²", 2, "plain ASCII"),
        ("ｕ*2", 1, "plain ASCII"),
        ("u\x00", 2, "plain ASCII"),
        ("u +", 4, "invalid syntax"),
        ("(u", 1, "never closed"),
        ("2 u", 3, "invalid syntax"),
        ("u; x", 2, "invalid syntax"),
    ],
)  # fmt: skip
def test_refusals_point_at_the_column(text, at, says):
    error = refused(text)
    assert says in error.what
    assert column(error) == at


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("  \t ", "empty"),
        ("u\n+ x", "one line"),
        ("u # the field", "one line"),
        ("u + " * 6000 + "u", "longer than 20000 characters"),
        ("sin(" * 70 + "u" + ")" * 70, "nested deeper than 60 levels"),
        ("-" * 1500 + "u", ""),
        ("-" * 19000 + "u", ""),
        ("u*" * 9000 + "u", ""),
        ("(" * 900 + "u" + ")" * 900, ""),
        ("9" * 1900, "not a finite real number"),
    ],
)
def test_refusals_of_whole_texts(text, says):
    begin = time.perf_counter()
    assert says in refused(text).what
    assert time.perf_counter() - begin < 2


def test_a_sum_may_have_as_many_terms_as_a_corrected_equation_needs():
    """One for each parameter of each episode, in parentheses, as corrected.yaml has them."""
    long = " + ".join(f"({i}.5*u**2/(lam + {i}))" for i in range(200))
    assert len(long) > 4000
    expr = parse(f"{long} - 3*u", LINE, where="")
    assert isinstance(expr, algebra.Sum) and len(expr.terms) == 201


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("lamb*u", "lam?"),
        ("alhpa*u", "alpha?"),
        ("lapl(u)", "lap?"),
        ("grad(u)", "grad2?"),
        ("lambda*u", "'lam'"),
        ("in*u", "'in_0'"),
        ("qqq", "one of: alpha, lam, t, u, x"),
        ("d(u, xx)", "x?"),
    ],
)
def test_refusals_suggest_the_nearest(text, hint):
    assert hint in str(refused(text).hint)


@pytest.mark.parametrize("text", ["d(theta, x)", "lap(theta)", "inv_lap(omega)", "grad2(theta)"])
def test_spatial_operators_need_space(text):
    assert "spatial axis" in refused(text, ODE).what


def test_a_flux_needs_an_equation():
    error = refused("flux(u, x)", Vocabulary(frozenset({"u"}), ("x",)))
    assert "equations and libraries only" in error.what


def test_the_mark_stays_in_sight_in_a_long_text():
    text = "u + " * 12 + "typo" + " + u" * 40
    assert column(refused(text)) == 49
    _, shown, mark = refused(text).what.splitlines()
    assert shown[mark.index("^") :].startswith("typo")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2*pi", 2 * math.pi),
        ("0.1/15", 0.1 / 15),
        (" -1e-3 ", -1e-3),
        ("2**-1", 0.5),
        ("sqrt(2) + abs(-1) - sign(-3) + step(2)", math.sqrt(2) + 3),
        ("sech(0) + tanh(0) + cos(pi)", 0.0),
        ("1_000", 1000.0),
    ],
)
def test_numbers(text, value):
    assert number(text, where="here") == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("text", ["u", "t", "two", "lap(1)", "1/0", ""])
def test_what_is_no_number(text):
    with pytest.raises(InputError, match=r"^here: "):
        number(text, where="here")


pieces = st.sampled_from(
    sorted(KNOWN | LINE.names)
    + list("+-*/^%()[]{},.:;=<>!~@'\"\\ \t\n#_019")
    + ["**", "//", "1e9", "9**9", "lambda", "__", "é", "²", "\x00", "0x", "1j", "import "]
)


@settings(max_examples=300)
@given(st.one_of(st.lists(pieces, max_size=25).map("".join), st.text(max_size=60)))
def test_any_text_is_read_or_refused(text):
    begin = time.perf_counter()
    try:
        expr = parse(text, LINE, where="fuzz")
    except InputError as error:
        assert error.where == "fuzz"
    else:
        assert parse(algebra.to_text(expr), LINE, where="fuzz") == expr
        assert algebra.names(expr) <= LINE.names
    assert time.perf_counter() - begin < 2
