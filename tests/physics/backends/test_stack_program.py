"""Programs of the stack machine; their values are tested with the functions of the language."""

from __future__ import annotations

import math

import pytest

from dashred.physics.backends.stack_program import NamePlaces, Op, build_programs, stack_depth
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.expressions.parser import Vocabulary, parse
from tests.physics.stack import by_stack

KNOWN = Vocabulary(frozenset({"u", "v"}), ("x",))


def expr(text: str):
    return parse(text, KNOWN, where="test")


def test_every_function_of_the_language_has_an_instruction() -> None:
    assert {name.upper() for name in FUNCTIONS} <= set(Op.__members__)


def test_a_name_is_a_value_or_a_weight() -> None:
    assert by_stack([expr("u - 2*v")], {"u": 1}, [9.0, 5.0], [0.0, 3.0], {"v": 1}) == [-1.0]


def test_a_branch_that_is_not_chosen_is_not_computed() -> None:
    text = "where(u > 0, where(u > 4, 1/(u - 9), sqrt(u)), 1/(u + 1))"
    found = [by_stack([expr(text)], {"u": 0}, [u])[0] for u in (10.0, 4.0, -3.0)]
    assert found == [1.0, 2.0, -0.5]


def test_what_is_not_finite_stays_so() -> None:
    assert by_stack([expr("1/u")], {"u": 0}, [0.0]) == [math.inf]
    assert math.isnan(by_stack([expr("log(u)")], {"u": 0}, [-1.0])[0])
    assert math.isnan(by_stack([expr("u**0.5")], {"u": 0}, [-1.0])[0])


def test_the_stack_is_never_deeper_than_the_longest_program() -> None:
    programs = build_programs([(expr(t), NamePlaces({"u": 0}, {})) for t in ("u", "u*(u + u**4)")])
    assert stack_depth(programs) == 7
    assert stack_depth(build_programs([])) == 0


def test_derivatives_in_space_have_no_program() -> None:
    with pytest.raises(TypeError, match="not pointwise"):
        build_programs([(expr("d(u, x)"), NamePlaces({"u": 0}, {}))])
