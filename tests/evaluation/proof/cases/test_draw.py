"""The draw: a function of its seed alone, with all kinds in it."""

from __future__ import annotations

from collections import Counter

import pytest

from dashred.config import load_config
from dashred.evaluation.proof.cases.case_record import KINDS
from dashred.evaluation.proof.cases.draw import KIND_DECKS, Case, draw_cases, seed_of
from dashred.evaluation.proof.cases.systems import SYSTEMS, ProofSystem
from dashred.physics.system import System, Term
from dashred.physics.terms.library import build_library

CASES = draw_cases(seed_of("a commit"), 120, 100)


def test_the_same_seed_draws_the_same_and_another_draws_others() -> None:
    assert draw_cases(seed_of("a commit"), 120, 100) == CASES
    others = draw_cases(seed_of("another"), 120, 100)
    alike = sum(a.noise == b.noise for a, b in zip(CASES, others, strict=True))
    assert alike < 0.05 * len(CASES)


def test_fewer_cases_are_the_first_of_more() -> None:
    cases = [case for case in CASES if case.group == "cases"]
    assert draw_cases(seed_of("a commit"), 30, 0) == cases[:30]
    assert draw_cases(seed_of("a commit"), 0, 10) == [c for c in CASES if c.group == "nulls"][:10]


def test_every_kind_is_drawn_several_times() -> None:
    kinds = Counter(case.kind for case in CASES if case.group == "cases")
    assert kinds.keys() == set(KINDS)
    assert min(kinds.values()) >= 3
    assert {kind for deck in KIND_DECKS.values() for kind in deck} == set(KINDS)


def test_a_third_of_the_nulls_have_other_troubles_and_none_a_law() -> None:
    nulls = [case.hidden for case in CASES if case.group == "nulls"]
    assert not any(hidden["terms"] or hidden.get("parameters") for hidden in nulls)
    troubled = [set(hidden) - {"terms"} for hidden in nulls if len(hidden) > 1]
    assert 33 <= len(troubled) <= 34
    counts = Counter(key for keys in troubled for key in keys)
    assert counts.keys() == {"correlation", "stated", "faults"} and min(counts.values()) >= 11


def of_kind(kind: str) -> list[Case]:
    """Return many cases of one kind."""
    many = draw_cases(seed_of("many"), 1500, 0)
    return [case for case in many if case.kind == kind]


def test_gates_are_of_the_upper_half_of_sizes() -> None:
    gates = of_kind("gate")
    effects = [case.effect for case in gates if case.effect is not None and case.system == "fhn"]
    low, high = SYSTEMS["fhn"].effect
    assert (low * high) ** 0.5 <= min(effects) < max(effects) <= high
    assert min(case.share for case in gates if case.share is not None) > 0.03


def test_laws_have_one_to_three_terms_over_a_decade() -> None:
    drawn = of_kind("terms")
    counts = Counter(len(case.hidden["terms"]) for case in drawn)
    assert counts.keys() == {1, 2, 3}
    for proved in SYSTEMS.values():
        low, high = proved.effect
        effects = [c.effect for c in drawn if c.effect is not None and c.system == proved.name]
        assert low <= min(effects) < 1.5 * low and high / 1.5 < max(effects) <= high
    least, most = SYSTEMS["fhn"].effect
    assert most / least >= 10
    shares = [case.share for case in drawn if case.share is not None]
    assert {case.system for case in drawn if case.share is not None} == {"ks1d"}
    assert max(shares) / min(shares) > 5
    for case in drawn:
        names = [(term["equation"], term["term"]) for term in case.hidden["terms"]]
        assert len(set(names)) == len(names)


def test_no_order_tells_the_kinds() -> None:
    orders = {
        tuple(case.kind for case in draw_cases(seed_of(f"draw {j}"), 30, 0)) for j in range(10)
    }
    assert len(orders) == 10
    troubled = {
        tuple(len(case.hidden) > 1 for case in draw_cases(seed_of(f"draw {j}"), 0, 12))
        for j in range(10)
    }
    assert len(troubled) > 5


def test_the_constants_of_what_lies_outside_are_drawn() -> None:
    drawn = [case.hidden["terms"][0]["term"] for case in of_kind("outside")]
    assert not any("{" in text for text in drawn)
    assert len({text for text in drawn if text.startswith("sin(")}) > 5


def test_windows_lie_within_the_axis_and_the_record() -> None:
    for kind in ("box", "onset", "gate"):
        for case in of_kind(kind):
            [term] = case.hidden["terms"]
            proved = SYSTEMS[case.system]
            [(of, (begin, end))] = [(k, v) for k, v in term["window"].items() if k != "edge"]
            if kind == "box":
                assert of == proved.axis[0] and 0 <= begin < end <= proved.axis[1]
            elif kind == "onset":
                assert of == "t" and 0 < begin < 0.8 * proved.duration and end is None
            else:
                assert of == proved.gated[0] and (begin is None) != (end is None)


@pytest.mark.parametrize("proved", SYSTEMS.values(), ids=SYSTEMS)
def test_the_terms_are_those_of_the_analysis_and_what_lies_beyond_is_not(
    proved: ProofSystem,
) -> None:
    config = load_config([f"conf={proved.name}"], entry="train")
    system = System(config.system, config.where)
    library = build_library(system, config.library)
    known = {(term.equation, str(term)) for term in library}

    def normal(terms: dict[str, tuple[str, ...]]) -> set[tuple[str, str]]:
        found = set()
        for equation, texts in terms.items():
            for text in texts:
                drawn = text.format(a=2.34, p=1.2)
                parsed = system.parse(drawn, "test", equation=equation)
                found.add((equation, str(Term(equation, parsed))))
        return found

    assert normal(proved.terms) <= known
    assert normal(proved.local) <= known
    assert normal(proved.switched) <= known
    assert not normal(proved.beyond) & known
