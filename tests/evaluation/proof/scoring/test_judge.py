"""What counts as right, and as listed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from dashred.config import frozen_input, load_config
from dashred.evaluation.proof.cases.case_record import Kind
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.effect_size import CaseTruth
from dashred.evaluation.proof.scoring.judge import FLAGGED, is_listed, is_right
from dashred.evaluation.twins.sealing import Concealed as Hidden
from dashred.evaluation.twins.sealing import SealedFault, SealedTerm
from dashred.physics.system import System

CONFIG = load_config(["conf=fhn"], entry="train")
SYSTEM = System(CONFIG.system, CONFIG.where)
BOX = ("x", 3.0, 8.0, 0.2)
V2 = SealedTerm("v", "v**2", 0.03)


def concealed(*terms: SealedTerm, **hidden: Any) -> CaseTruth:
    truth = SimpleNamespace(terms=terms, concealed=Hidden(**hidden))
    return cast(CaseTruth, SimpleNamespace(truth=truth, system=SYSTEM, config=CONFIG))


def case_of(kind: Kind) -> Case:
    return Case(0, "cases", "fhn", kind, (0, 0, 0), 0.03, 12, {"terms": []}, None)


def term(equation: str, text: str, region: list[dict[str, Any]] | None = None) -> dict[str, Any]:
    return {"equation": equation, "term": text, "coefficient": 0.031, "region": region}


def findings(
    verdict: str | None,
    *terms: dict[str, Any],
    causes: tuple[dict[str, Any], ...] = (),
    rivals: tuple[list[dict[str, Any]], ...] = (),
) -> dict[str, Any]:
    first = {"kind": verdict, "probability": 0.9}
    return {
        "verdict": verdict,
        "terms": list(terms),
        "causes": list(causes) or [first],
        "alternatives": [
            {"terms": law, "delta_bic": 1.0, "rival": True, "same_as_best": False} for law in rivals
        ],
        "input": {"config": frozen_input(CONFIG)},
    }


def test_a_null_is_right_if_nothing_is_missing() -> None:
    case, truth = case_of("null"), concealed()
    assert is_right(case, findings("nothing-missing"), truth)
    assert not is_right(case, findings("missing-term", term("v", "v**2")), truth)
    assert not is_right(case, findings(None), truth)


def test_a_null_whose_misplaced_sensor_is_named_is_right() -> None:
    truth = concealed(faults=(SealedFault("s05", "misplaced", 0.05),))
    cause = {"kind": "sensor-fault", "sensor": "s05", "fault": "misplaced", "probability": 1.0}
    assert is_right(case_of("null"), findings("sensor-fault", causes=(cause,)), truth)
    other = findings("sensor-fault", causes=(cause | {"sensor": "s06"},))
    assert not is_right(case_of("null"), other, truth)


def test_a_law_is_right_in_its_exact_form_alone() -> None:
    case, truth = case_of("terms"), concealed(V2)
    assert is_right(case, findings("missing-term", term("v", "v**2")), truth)
    assert not is_right(case, findings("ambiguous", term("v", "v**2")), truth)
    assert not is_right(case, findings("missing-term", term("u", "v**2")), truth)
    more = findings("missing-term", term("v", "v**2"), term("u", "u"))
    assert not is_right(case, more, truth)


def test_a_window_is_part_of_the_form() -> None:
    truth = concealed(SealedTerm("v", "v**2", 0.03, BOX))
    box = [{"axis": "x", "from": 3.1, "to": 7.9, "std": 0.1}]
    assert is_right(case_of("box"), findings("missing-term", term("v", "v**2", box)), truth)
    assert not is_right(case_of("box"), findings("missing-term", term("v", "v**2")), truth)


def test_a_parameter_is_right_by_its_effect() -> None:
    case, truth = case_of("parameter"), concealed(parameters={"c": 1.03})
    change = {"equation": None, "parameter": "c", "term": "c", "coefficient": 0.031, "to": 1.031}
    assert is_right(case, findings("parameter", change), truth)
    other = change | {"parameter": "D"}
    assert not is_right(case, findings("parameter", other), truth)
    # What cannot be told apart is one answer, if it is given as that.
    assert is_right(case, findings("parameter", other | {"aliases": ["c"]}), truth)


@pytest.mark.parametrize(("sensor", "kind", "right"), [
    ("s05", "bias", True),
    ("s06", "bias", False),
    ("s05", "drift", False),
])  # fmt: skip
def test_a_fault_is_right_with_its_sensor_and_kind(sensor, kind, right) -> None:
    truth = concealed(faults=(SealedFault("s05", "bias", 0.2),))
    cause = {"kind": "sensor-fault", "sensor": sensor, "fault": kind, "probability": 1.0}
    assert is_right(case_of("fault"), findings("sensor-fault", causes=(cause,)), truth) is right


def test_a_fault_told_beside_a_law_has_to_be_a_true_one() -> None:
    law = {"kind": "missing-term", "probability": 0.99}
    fault = {"kind": "sensor-fault", "sensor": "s05", "fault": "bias", "probability": 0.99}
    told = findings("missing-term", term("v", "v**2"), causes=(law, fault))
    hidden = (SealedFault("s05", "bias", 0.2),)
    assert is_right(case_of("masked"), told, concealed(V2, faults=hidden))
    assert not is_right(case_of("masked"), told, concealed(V2))
    assert not is_right(case_of("terms"), told, concealed(V2))
    assert not is_listed(case_of("terms"), told, concealed(V2))
    rival = [{**term("v", "v**2"), "window": None}]
    listed = findings("ambiguous", term("v", "v**2"), causes=(law, fault), rivals=(rival,))
    assert is_listed(case_of("terms"), listed, concealed(V2))
    beyond = {"kind": "outside-library", "probability": 1.0}
    outside = findings("outside-library", term("v", "v"), causes=(beyond, law, fault))
    unknown = SealedTerm("u", "sin(2*u)", 0.1)
    assert not is_right(case_of("outside"), outside, concealed(unknown))
    assert is_right(case_of("outside"), outside, concealed(unknown, faults=hidden))
    extended = beyond | {"terms": ["u: sin(2*u)"], "probability": 0.99}
    found = findings("outside-library", term("u", "sin(2*u)"), causes=(extended, fault))
    assert not is_right(case_of("outside"), found, concealed(unknown))
    # An explanation of its own, less likely than the law, accuses nobody.
    other = findings("missing-term", term("v", "v**2"), causes=(law, fault | {"probability": 0.01}))
    assert is_right(case_of("terms"), other, concealed(V2))


def test_of_masked_causes_each_that_is_named_has_to_be_true() -> None:
    case, truth = case_of("masked"), concealed(V2, parameters={"c": 1.03})
    change = {"equation": None, "parameter": "c", "term": "c", "coefficient": 0.031, "to": 1.031}
    change |= {"region": None}
    assert is_right(case, findings("missing-term", term("v", "v**2")), truth)
    assert is_right(case, findings("missing-term", term("v", "v**2"), change), truth)
    assert not is_right(case, findings("missing-term", term("v", "v**2"), term("u", "u")), truth)


def test_outside_of_the_library_is_right_if_it_is_said() -> None:
    truth = concealed(SealedTerm("u", "sin(2*u)", 0.1))
    assert is_right(case_of("outside"), findings("outside-library", term("u", "u")), truth)
    assert not is_right(case_of("outside"), findings("missing-term", term("u", "u")), truth)


def test_a_law_is_listed_among_the_first_three_alone() -> None:
    case, truth = case_of("box"), concealed(SealedTerm("v", "v**2", 0.03, BOX))
    true = [{**term("v", "v**2"), "window": {"axis": "x", "from": 3.1, "to": 7.9}}]
    other = [term("u", "u") | {"window": {"field": "u", "above": 0.1}}]
    best = term("u", "v")
    assert is_listed(case, findings("ambiguous", best, rivals=(other, true)), truth)
    assert not is_listed(case, findings("ambiguous", best, rivals=(other, other, true)), truth)
    assert not is_listed(case, findings("ambiguous", best, rivals=(other,)), truth)


def test_other_causes_are_listed_by_name() -> None:
    truth = concealed(faults=(SealedFault("s05", "bias", 0.2),))
    fault = {"kind": "sensor-fault", "sensor": "s05", "fault": "bias", "probability": 0.4}
    start = {"kind": "initial-condition", "start": 3.0, "probability": 0.6}
    told = findings("ambiguous", causes=(start, fault))
    assert is_listed(case_of("fault"), told, truth)
    assert not is_listed(case_of("fault"), findings("ambiguous", causes=(start,)), truth)
    assert not is_listed(case_of("null"), told, concealed())


def test_that_nothing_is_missing_is_listed_where_that_is_the_truth_alone() -> None:
    nothing = {"kind": "nothing-missing", "probability": 0.6}
    told = findings("ambiguous", causes=(nothing,))
    assert is_listed(case_of("null"), told, concealed())
    assert not is_listed(case_of("numerics"), told, concealed())


def test_an_unconfirmed_law_is_flagged_and_listed_but_not_right() -> None:
    case, truth = case_of("terms"), concealed(V2)
    suggested = findings("unconfirmed", term("v", "v**2"))
    assert "unconfirmed" in FLAGGED
    assert not is_right(case, suggested, truth) and is_listed(case, suggested, truth)
    assert not is_right(case_of("null"), suggested, concealed())
