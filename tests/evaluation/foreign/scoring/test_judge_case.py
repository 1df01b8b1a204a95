"""Outcomes of constructed findings, by kind of what is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.evaluation.foreign.cases.case import TrueTerm, Truth
from dashred.evaluation.foreign.scoring.judge import judge
from tests.evaluation.foreign.invented import DECAY, RING, findings_of, system_of, term

TIMES = np.linspace(0, 5, 60)
STATES = np.stack([1.2 + np.sin(TIMES), np.cos(1.7 * TIMES)], axis=1)
HIDDEN = np.stack([-0.3 * STATES[:, 0] ** 2, 0 * TIMES], axis=1)
LAW = Truth("term", "", TIMES, STATES, HIDDEN, (TrueTerm("x", "x**2", -0.3),))
RIGHT, WRONG = [term("x", "x**2", -0.3)], [term("x", "x", -0.3)]


def outcome(truth: Truth, verdict: str | None, terms=(), causes=(), **more) -> str:
    found = findings_of(DECAY, verdict, terms, causes, **more)
    return judge(found, truth, system_of(DECAY)).outcome


def alternative(terms, *, rival: bool = True, same: bool = False):
    shown = [{**t, "window": None} for t in terms]
    return {"terms": shown, "rival": rival, "same_as_best": same, "delta_bic": 1.0}


@pytest.mark.parametrize(
    ("verdict", "terms", "alternatives", "expected"),
    [
        ("missing-term", RIGHT, [], "right"),
        ("missing-term", WRONG, [], "silent-wrong"),
        ("missing-term", WRONG, [alternative(RIGHT, same=True)], "right"),
        ("missing-term", WRONG, [alternative(RIGHT)], "silent-wrong"),
        ("nothing-missing", [], [], "silent-wrong"),
        ("sensor-fault", [], [], "silent-wrong"),
        ("ambiguous", RIGHT, [], "listed"),
        ("ambiguous", WRONG, [alternative(RIGHT)], "listed"),
        ("ambiguous", WRONG, [alternative(WRONG)], "flagged"),
        ("unconfirmed", RIGHT, [], "listed"),
        ("outside-library", RIGHT, [], "listed"),
        ("not-converged", [], [], "flagged"),
        (None, [], [], "no-answer"),
    ],
)
def test_a_law_that_is_left_out(verdict, terms, alternatives, expected: str) -> None:
    assert outcome(LAW, verdict, terms, alternatives=alternatives) == expected


def test_a_force_without_a_name_is_right_outside_of_the_library_in_its_equation() -> None:
    nameless = replace(LAW, terms=())
    for equation, expected in (("x", "right"), ("y", "flagged")):
        shares = {"x": 0.1, "y": 0.1, equation: 0.9}
        where = {"equation": shares, "forcing": None}
        assert outcome(nameless, "outside-library", where=where) == expected
    assert outcome(nameless, "outside-library") == "flagged"
    assert outcome(LAW, "outside-library", where={"equation": {"x": 1.0}}) == "flagged"


def test_where_a_sensor_errs_it_alone_has_to_be_named() -> None:
    erring = replace(LAW, kind="sensor", sensor="s4", terms=(), hidden=0 * HIDDEN)
    fault = {"kind": "sensor-fault", "sensor": "s4", "fault": "drift", "probability": 0.9}
    other = {**fault, "sensor": "s5"}
    assert outcome(erring, "sensor-fault", [], [fault]) == "right"
    assert outcome(erring, "sensor-fault", [], [other, fault]) == "silent-wrong"
    assert outcome(erring, "sensor-fault", WRONG, [fault]) == "silent-wrong"
    assert outcome(erring, "missing-term", WRONG) == "silent-wrong"
    law = {"kind": "outside-library", "probability": 1.0}
    assert outcome(erring, "outside-library", [], [law, fault]) == "listed"
    assert outcome(erring, "outside-library", [], [law, other]) == "flagged"


def test_where_nothing_is_hidden_everything_else_is_a_false_alarm() -> None:
    nothing = replace(LAW, kind="nothing", terms=(), hidden=0 * HIDDEN)
    assert outcome(nothing, "nothing-missing") == "right"
    assert outcome(nothing, "missing-term", WRONG) == "silent-wrong"
    causes = [{"kind": kind, "probability": 0.5} for kind in ("missing-term", "nothing-missing")]
    assert outcome(nothing, "ambiguous", WRONG, causes) == "listed"
    assert outcome(nothing, "ambiguous", WRONG) == "flagged"


def source_outcome(verdict: str, peak: float | None = None, region=None, place=None):
    states = np.ones((5, 1, 40))
    truth = Truth("source", "", np.arange(5.0), states, 0.1 * states, region=(9.0, 1.0))
    forcing = None if peak is None else {"peak": [peak, 2.0]}
    terms = [term("u", "1", 0.3, region=[region])] if region else []
    source = None if place is None else {"place": [place]}
    where = {"equation": {"u": 1.0}, "forcing": forcing, "source": source}
    found = findings_of(RING, verdict, terms, where=where)
    return judge(found, truth, system_of(RING))


def test_a_source_has_to_be_located() -> None:
    assert source_outcome("outside-library", peak=0.5).outcome == "right"
    assert source_outcome("outside-library", peak=9.5).outcome == "right"
    assert source_outcome("outside-library", peak=-0.5).outcome == "right"
    assert source_outcome("outside-library", peak=2.0).outcome == "flagged"
    assert source_outcome("not-converged", peak=0.5).outcome == "listed"
    assert source_outcome("nothing-missing").outcome == "silent-wrong"
    assert source_outcome("outside-library", peak=0.5).located is True
    assert source_outcome("outside-library").located is False


def test_a_source_may_be_told_as_a_term_in_a_region() -> None:
    inside, outside = ({"axis": "x", "from": a, "to": a + 1.0} for a in (9.2, 4.0))
    assert source_outcome("missing-term", region=inside).outcome == "right"
    assert source_outcome("missing-term", region=outside).outcome == "silent-wrong"
    assert source_outcome("missing-term", peak=0.5, region=outside).located is False


def test_a_told_source_counts_before_the_coarser_map() -> None:
    assert source_outcome("outside-library", place=0.5).outcome == "right"
    assert source_outcome("outside-library", place=0.5, peak=2.0).located is True
    assert source_outcome("outside-library", place=2.0, peak=0.5).located is False


def test_the_leading_cause_counts_although_the_verdict_is_uncertain() -> None:
    for verdict, terms, leading in (
        ("missing-term", RIGHT, True),
        ("ambiguous", RIGHT, True),
        ("ambiguous", WRONG, False),
        ("missing-term", WRONG, False),
    ):
        judged = judge(findings_of(DECAY, verdict, terms), LAW, system_of(DECAY))
        assert judged.leading is leading
        assert judged.covered == ([True] if leading else [])
