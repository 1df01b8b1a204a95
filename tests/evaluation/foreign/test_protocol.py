"""The protocol: the draw follows from a text, and it is complete."""

from __future__ import annotations

from collections import Counter

import pytest

from dashred.core.errors import InputError
from dashred.evaluation.foreign.cases.case import KINDS
from dashred.evaluation.foreign.cases.field_equations import FIELD_EQUATIONS
from dashred.evaluation.foreign.cases.mechanisms import MECHANISMS
from dashred.evaluation.foreign.protocol import commit_of_tag, draw_cases

SYSTEMS = ["Lorenz", "Rossler"]


def test_the_same_text_gives_the_same_cases_and_another_text_others() -> None:
    first, again = (draw_cases("abc", SYSTEMS, (0.02,), 3) for _ in range(2))
    assert first == again
    numbers = [case.stream("what").random() for case in first]
    assert numbers == [case.stream("what").random() for case in again]
    others = [case.stream("what").random() for case in draw_cases("abd", SYSTEMS, (0.02,), 3)]
    assert not set(numbers) & set(others)


def test_all_streams_of_a_draw_differ() -> None:
    cases = draw_cases("abc", SYSTEMS, (0.02, 0.05), 2)
    numbers = [case.stream(of).random() for case in cases for of in ("what", "noise")]
    assert len(set(numbers)) == len(numbers)
    assert len({case.analysis_seed for case in cases}) == len(cases)


def test_the_draw_has_every_system_as_often_as_every_other() -> None:
    cases = draw_cases("abc", SYSTEMS, (0.02, 0.05), 3)
    names = [case.name for case in cases]
    assert len(set(names)) == len(names)
    counts = Counter((case.collection, case.system, case.noise) for case in cases)
    for system in SYSTEMS:
        assert counts["dysts", system, 0.02] == counts["dysts", system, 0.05] == 3
    assert {counts["fields", system, 0.02] for system in FIELD_EQUATIONS} == {10}
    assert {counts["mechanics", system, 0.02] for system in MECHANISMS} == {5}
    assert {case.kind for case in cases} == set(KINDS)


def test_there_are_as_many_fields_and_draws_as_promised() -> None:
    cases = draw_cases("abc", SYSTEMS, (0.02,), 1)
    assert len(FIELD_EQUATIONS) >= 12
    assert sum(case.collection != "dysts" for case in cases) >= 120


def test_half_of_the_sources_pulsate() -> None:
    sources = [case for case in draw_cases("abc", [], (0.02,), 1) if case.kind == "source"]
    assert sum(case.number % 2 for case in sources) == len(sources) / 2


def test_a_tag_that_does_not_exist_is_told() -> None:
    with pytest.raises(InputError, match="no tag no-such-tag") as caught:
        commit_of_tag("no-such-tag")
    assert caught.value.hint and "git tag" in caught.value.hint
