"""The numbers to reach: each is met by what is good enough, and lost by one record more."""

from __future__ import annotations

from typing import Any, cast

import pytest

from dashred.evaluation.proof.cases.case_record import KINDS, CaseRecord
from dashred.evaluation.proof.scoring.outcomes import leading_right, shortcomings
from dashred.evaluation.proof.scoring.statistics import Rate
from dashred.evaluation.proof.scoring.targets import (
    TARGETS,
    Measured,
    Target,
    coefficients,
    coverage,
)
from tests.evaluation.proof.invented import case, coefficient, dead, gaining, null, proof, wrong


def oracle(**more: Any) -> dict[str, Any]:
    known = {"over_null": 200.0, "over_rival": 30.0, "decidable": True, "lost": 0.0}
    return known | {"over_library": 50.0} | more


def region(**more: float) -> dict[str, Any]:
    return dict.fromkeys(("overlap", "onset", "threshold", "threshold_z")) | more


def target(name: str) -> Target:
    return next(target for target in TARGETS if target.name.startswith(name))


def outcome(name: str, records: list[CaseRecord]) -> str:
    chosen = target(name)
    return chosen.outcome(chosen.measure(records))


def measured(name: str, records: list[CaseRecord]) -> Measured:
    return target(name).measure(records)


def gained(test_sensors: float, forecast: float | None) -> CaseRecord:
    return case(gains=gaining(test_sensors, forecast))


GOOD = case()
SHAKY = case(coefficients=[coefficient(found=-0.155)] * 10)
SURE = case(coefficients=[coefficient(found=-0.1501)] * 10)
MISSED = case(oracle=oracle(lost=6.1))
STUCK = wrong(verdict="not-converged")
NAMED = [case(kind="start")] * 12 + [case(kind="fault")] * 7
OFF_PEAK = case(peak_inside=False)
ELSEWHERE = wrong(kind="hidden", equation_right=False)
ROUGH = case(coefficients=[coefficient(found=-0.157), coefficient(found=-0.2, std=0.02)])
INSIDE = wrong(kind="outside")
OUTSIDE = wrong(verdict="outside-library")
NEAR = [
    case(region=region(threshold=0.1)),
    case(region=region(threshold=0.2, threshold_z=-2.0)),
]
BLURRED = case(oracle=oracle(decidable=False))
FLIPS: list[tuple[str, list[CaseRecord], CaseRecord]] = [
    ("verdict right", [GOOD] * 4 + [wrong()], wrong()),
    ("right, or ambiguous", [case(right=False)] * 23 + [wrong()] * 2, wrong()),
    ("decidable cases", [GOOD] * 9 + [wrong()], case(exact=False)),
    ("undecidable", [GOOD] * 3 + [BLURRED], BLURRED),
    ("wrong and unflagged", [GOOD] * 97 + [wrong()] * 3, wrong()),
    ("not converged", [GOOD] * 9 + [STUCK], STUCK),
    ("search failures", [case(oracle=oracle(lost=6.0))] * 97 + [MISSED] * 3, MISSED),
    ("start, sensor fault", [*NAMED, wrong(kind="fault")], wrong(kind="numerics")),
    ("false alarms", [null()] * 97 + [null(right=False)] * 3, null(right=False)),
    ("region", [case(region=region(overlap=0.9))], case(region=region(overlap=0.7))),
    ("told place", [case(peak_inside=True)] * 17 + [OFF_PEAK] * 3, OFF_PEAK),
    ("onset", [case(region=region(onset=0.05))], case(region=region(onset=0.06))),
    ("threshold", NEAR, case(region=region(threshold=0.2, threshold_z=2.5))),
    ("hidden field", [case(kind="hidden")] * 9 + [ELSEWHERE], ELSEWHERE),
    ("coefficients within", [ROUGH], case(coefficients=[coefficient(found=-0.16)])),
    ("error of coefficients", [SURE], case(coefficients=[coefficient(found=-0.16)] * 30)),
    ("95 % intervals", [SURE] * 9 + [SHAKY], SHAKY),
    ("outside the library", [case(kind="outside")] * 17 + [INSIDE] * 3, INSIDE),
    ("reported as outside", [GOOD] * 49 + [OUTSIDE], OUTSIDE),
    ("gain at test sensors, ", [gained(3.0, None)], gained(1.5, 99.0)),
    ("gain at test sensors over", [gained(6.0, None)], gained(3.0, 99.0)),
    ("gain of the forecast, ", [gained(0.1, 6.0)], gained(9.0, 2.0)),
    ("gain of the forecast over", [gained(1.0, 11.0)], gained(9.0, 2.0)),
    ("largest increase of the error on noisy", [case(noisy_test=0.02)] * 50, case(noisy_test=0.03)),
    ("seconds", [case(seconds=90.0)] * 3, case(seconds=91.0)),
]


@pytest.mark.parametrize(("name", "records", "more"), FLIPS, ids=[name for name, _, _ in FLIPS])
def test_one_record_more_and_the_target_is_lost(
    name: str, records: list[CaseRecord], more: CaseRecord
) -> None:
    assert outcome(name, records) == "met"
    assert outcome(name, [*records, more]) == "not met"


def test_every_target_is_held_to_that() -> None:
    assert len({target(name).name for name, _, _ in FLIPS}) == len(TARGETS)


def test_no_record_meets_or_misses_anything() -> None:
    for chosen in TARGETS:
        assert chosen.outcome(chosen.measure([])) == "no data"


def test_a_case_that_died_is_not_right_and_was_given_no_verdict() -> None:
    records = [case(), dead()]
    assert measured("verdict right", records).value == Rate(1, 2)
    for name in ("wrong and unflagged", "not converged", "search failures", "decidable cases"):
        assert measured(name, records).n == 1
    assert measured("false alarms", [null(), dead() | {"group": "nulls"}]).value == Rate(0, 1)


def test_nulls_are_counted_apart() -> None:
    strange = null(right=False, verdict="outside-library")
    records = [case(), strange]
    assert measured("verdict right", records).value == Rate(1, 1)
    assert measured("reported as outside", records).value == Rate(0, 1)
    assert measured("false alarms", records).value == Rate(1, 1)


def test_boxes_and_gates_do_not_mend_the_coverage_of_terms_everywhere() -> None:
    far = coefficient(found=-0.2)
    records = [case(coefficients=[far]), case(coefficients=[coefficient(window="box")] * 30)]
    assert measured("95 % intervals", records).value == Rate(0, 1)
    assert coverage(coefficients(records)) == Rate(30, 31)
    assert coverage([coefficient(std=None)]) == Rate(0, 1)


def test_what_could_have_been_found_and_was_not_counts_as_missed() -> None:
    lost = case(kind="box", region=region(), peak_inside=None)
    blurred = lost | {"oracle": oracle(decidable=False)}
    found = measured("region", [case(kind="box"), lost, cast(CaseRecord, blurred)])
    note = "2 of 3 cases lack it, 1 of which count as missed"
    assert (found.value, found.n, found.note) == (0.48, 2, note)
    assert measured("told place", [case(kind="box"), lost]).value == Rate(1, 2)
    without_map = [case(kind="box", region=region(overlap=o), peak_inside=None) for o in (0.4, 0.6)]
    assert measured("told place", without_map).value == Rate(1, 2)
    for name, kind in (("onset", "onset"), ("threshold", "gate")):
        unfound = case(kind=kind, region=region())
        assert measured(name, [case(kind=kind), unfound]).value == Rate(1, 2)
        assert measured(name, [case(kind=kind), dead(kind=kind)]).value == Rate(1, 2)
    unnamed = case(kind="hidden", equation_right=None)
    assert measured("hidden field", [case(kind="hidden"), unnamed]).value == Rate(1, 2)


def test_a_law_that_was_not_found_gains_nothing_and_one_that_blows_up_loses_all() -> None:
    unfound, endless = case(gains=None), gained(8.0, None)
    assert measured("gain at test sensors over", [unfound]).value == 1.0
    assert measured("gain of the forecast over", [endless]).value == 0.0
    assert measured("gain at test sensors over", [case(kind="start"), null()]).n == 0


def test_what_has_not_converged_is_no_failure_of_the_search_and_yet_not_decided() -> None:
    lost = wrong(verdict="not-converged", flagged=True, oracle=oracle(lost=200.0), exact=None)
    assert measured("search failures", [lost]).n == 0
    assert measured("decidable cases", [lost]).value == Rate(0, 1)


def test_what_the_library_imitates_is_no_case_of_outside() -> None:
    near = wrong(kind="outside", oracle=oracle(over_library=20.0))
    assert measured("outside the library", [near]).n == 0


def test_the_worst_class_and_the_worst_case_are_named() -> None:
    blurred = case(kind="masked", oracle=oracle(decidable=False))
    found = measured("undecidable", [case(), case(), blurred])
    assert (found.value, found.note) == (Rate(1, 1), "worst class: outside, masked")
    # A class of enough cases is judged by itself.
    many = [case(kind="gate")] * 20 + [case(kind="gate", oracle=oracle(decidable=False))] * 10
    found = measured("undecidable", [*many, case(kind="box")])
    assert (found.value, found.note) == (Rate(10, 30), f"worst class: {KINDS['gate']}")
    worst = measured("largest increase of the error on noisy", [case(3), null(8, noisy_test=0.5)])
    assert (worst.value, worst.note) == (0.5, "worst: null 8")


def test_the_leading_cause_may_be_right_where_the_verdict_is_open() -> None:
    open_: dict[str, Any] = {"verdict": "ambiguous", "right": False, "flagged": True}
    assert leading_right(case(**open_, causes=["missing-term", "parameter"])) is True
    assert leading_right(case(**open_, causes=["parameter", "missing-term"])) is False
    assert leading_right(case(kind="masked", **open_, causes=["parameter"])) is None
    assert leading_right(dead()) is None


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (wrong(), "wrong and unflagged"),
        (wrong(flagged=True), "wrong, flagged"),
        (case(right=False, flagged=True), "flagged, truth listed"),
        (case(exact=False), "not the exact form"),
        (dead(), "failed: exit code -9"),
        (case(oracle=oracle(lost=7.25)), "search failure: the true form scores better by 7.25"),
        (case(noisy_test=0.031), "error on noisy test data larger by 3.1 %"),
        (case(kind="hidden", equation_right=False), "wrong equation of the hidden field"),
        (case(kind="box", peak_inside=False), "the told place is outside the region"),
        (case(region=region(onset=0.2)), "the onset is wrong"),
        (case(region=region(threshold=0.2)), "the threshold is wrong"),
        (case(coefficients=[coefficient(found=-0.3)]), "the coefficient of u: u**2 is wrong"),
    ],
)
def test_what_a_case_falls_short_in_is_said(record: CaseRecord, words: str) -> None:
    assert shortcomings(record) == [words]


def test_a_null_that_is_not_right_is_a_false_alarm() -> None:
    assert "false alarm" in shortcomings(null(verdict="sensor-fault", right=False))
    assert "false alarm" not in shortcomings(null(verdict="sensor-fault"))


def test_what_went_well_has_no_failings() -> None:
    assert not shortcomings(case()) and not shortcomings(null())
    assert not shortcomings(case(kind="outside", exact=False))
    assert any(shortcomings(record) for record in proof())
