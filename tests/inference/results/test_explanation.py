"""The law with its error bars, its probability, and the alternatives."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from dashred.core.findings.cause_schema import NONE_OF_THESE
from dashred.inference.fit.law import ErrorCurve, SensorFault
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.law_block import restrict_to_window
from dashred.inference.hypotheses.result import BestOfSize
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.inference.results.explanation import (
    alternatives,
    smaller_laws,
    terms_of_discovery,
    terms_of_law,
)
from dashred.inference.results.posterior_probabilities import posterior_probabilities
from dashred.inference.results.verdict import describe_fault
from dashred.physics.grids.grid import Axis
from dashred.physics.system import System
from dashred.physics.window import box, gate, onset
from dashred.reporting.text.regions import region_text
from dashred.reporting.text.sensor_faults import fault_text
from dashred.reporting.wording.findings_text import add_term_text, law_text
from tests import laws

CERTAIN = 1 - NONE_OF_THESE


@pytest.fixture(scope="module")
def flow(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("flow"))


def test_a_term_has_its_interval_and_its_text(flow: System) -> None:
    best = laws.law([laws.term(flow, "u", "u")], [-0.04], std=0.002)
    [found] = terms_of_discovery(flow, laws.discovery(best))
    add_term_text(found, flow)
    told: dict[str, Any] = dict(found)
    assert (told["equation"], told["term"], told["region"]) == ("u", "u", None)
    assert told["coefficient"] == pytest.approx(-0.04) and told["std"] == pytest.approx(0.002)
    assert told["ci95"] == pytest.approx([-0.04392, -0.03608], rel=1e-3)
    assert told["effect"] == "linear damping of internal energy"
    assert told["says"] == "linear damping of internal energy, −0.040 ± 0.004 per unit time"


@pytest.mark.parametrize(
    ("shape", "values", "region", "words"),
    [
        (
            box(Axis("x", 6.0, 32)),
            (2.0, 0.5, 0.0),
            {"axis": "x", "from": 1.5, "to": 2.5, "std": pytest.approx(0.05)},
            "for 1.5 < x < 2.5",
        ),
        (
            box(Axis("x", 6.0, 32)),
            (5.75, 0.75, 0.0),
            {
                "axis": "x",
                "from": pytest.approx(5.0),
                "to": pytest.approx(0.5),
                "std": pytest.approx(0.05),
            },
            "for x > 5 or x < 0.5",
        ),
        (
            box(Axis("x", 6.0, 32, "insulated")),
            (0.5, 1.0, 0.0),
            {"axis": "x", "from": 0.0, "to": pytest.approx(1.5), "std": pytest.approx(0.05)},
            "for 0 < x < 1.5",
        ),
        (onset(), (4.0, 0.0), {"axis": "t", "from": 4.0, "std": 0.03}, "for t > 4"),
        (gate("u", 1), (0.7, 0.0), {"field": "u", "above": 0.7, "std": 0.03}, "for u > 0.7"),
        (gate("u", -1), (0.7, 0.0), {"field": "u", "below": 0.7, "std": 0.03}, "for u < 0.7"),
    ],
)
def test_a_windowed_term_has_its_region(flow: System, shape, values, region, words) -> None:
    [candidate] = restrict_to_window([laws.term(flow, "u", "u")], shape.at(values))
    best = laws.law([candidate], [-0.04], std=0.002, edges=(0.03, 0.04, 1.0)[: len(values)])
    [found] = terms_of_discovery(flow, laws.discovery(best))
    add_term_text(found, flow)
    told: dict[str, Any] = dict(found)
    assert (told["term"], told["region"]) == ("u", [region])
    damping = "linear damping of internal energy, −0.040 ± 0.004 per unit time"
    assert told["says"] == f"{damping}, {words}"
    [other] = alternatives(laws.discovery(laws.law(), dataclasses.replace(best, score=3.0)), flow)
    window = other["terms"][0]["window"]
    assert window == {key: value for key, value in region.items() if key != "std"}
    assert window is not None and region_text(window) == words
    # The corrected system has the window in its equations.
    assert "tanh" in build_corrected_system(flow, best).config.equations["u"]
    everywhere = laws.law([laws.term(flow, "u", "u")], [1.0])
    assert "tanh" not in build_corrected_system(flow, everywhere).config.equations["u"]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (SensorFault("bias", "s1", 0.1234, 0.011, None), "sensor s1 has a bias of 0.12 ± 0.02"),
        (SensorFault("stuck", "s1", 1.5, None, 12.3), "sensor s1 is stuck at 1.5 from t = 12.3 on"),
        (
            SensorFault("spikes", "s1", 3.0, None, None),
            "sensor s1 has 3 spikes",
        ),
        (
            SensorFault("spikes", "s1", 1.0, None, None),
            "sensor s1 has 1 spike",
        ),
        (
            SensorFault(
                "wandering",
                "s1",
                -0.31,
                0.05,
                None,
                curves=(ErrorCurve((0.0, 2.5, 5.0), (0.1, -0.31, 0.2), (0.05, 0.05, 0.05)),),
            ),
            "the readings of sensor s1 wander: their largest error is −0.31 ± 0.10, at t = 2.5",
        ),
        (
            SensorFault("misplaced", "s1", -0.12, 0.02, None),
            "sensor s1 is −0.12 ± 0.04 away from its stated position",
        ),
    ],
)
def test_a_fault_as_text(fault: SensorFault, words: str) -> None:
    assert fault_text(describe_fault(fault)) == words


def test_a_parameter_is_given_by_its_new_value(flow: System) -> None:
    best = laws.law([laws.parameter(flow, "nu", aliases=("mu", "kappa"))], [-0.04], std=0.003)
    [found] = terms_of_discovery(flow, laws.discovery(best))
    add_term_text(found, flow)
    told: dict[str, Any] = dict(found)
    assert (told["equation"], told["parameter"], told["term"]) == (None, "nu", "nu")
    assert (told["from"], told["to"]) == (0.1, pytest.approx(0.06))
    assert told["coefficient"] == pytest.approx(-0.04)
    assert told["ci95"] == pytest.approx([0.06 - 0.00588, 0.06 + 0.00588], rel=1e-3)
    assert told["says"] == (
        "nu is 0.060 ± 0.006, not 0.1; a change of mu or kappa has the same effect"
    )


def test_a_nonlinear_parameter_is_approximate(flow: System) -> None:
    best = laws.law([laws.parameter(flow, "alpha")], [0.03], std=0.002)
    [found] = terms_of_discovery(flow, laws.discovery(best))
    add_term_text(found, flow)
    assert found["equation"] is None and not found["exact"]
    assert "to first order" in found["says"]


def test_inclusion_sums_over_all_laws_with_the_term(flow: System) -> None:
    u, cubic, lam = (laws.term(flow, "u", text) for text in ("u", "u**3", "lam"))
    both = laws.law([u, cubic], [0.1, -0.1], score=0.0)
    tried = laws.discovery(both, laws.law([u], [0.1], score=2.0), laws.law([lam], [1.0], score=4.0))
    first, second = terms_of_discovery(flow, tried)
    total = 1 + 0.36788 + 0.13534
    assert first["inclusion"] == pytest.approx(CERTAIN * 1.36788 / total, rel=1e-4)
    assert second["inclusion"] == pytest.approx(CERTAIN / total, rel=1e-4)


def test_the_empty_law_counts_once(flow: System) -> None:
    u = laws.term(flow, "u", "u")
    nothing = laws.law(score=1.0)
    best = laws.law([u], [0.1])
    for tried in (
        laws.discovery(best, uncorrected=nothing),
        laws.discovery(best, nothing, uncorrected=nothing),
    ):
        shares = [p for _, p in posterior_probabilities(tried)]
        assert shares == pytest.approx([CERTAIN * 0.62246, CERTAIN * 0.37754], rel=1e-4)


def test_alternatives_are_all_rivals_then_others_up_to_three(flow: System) -> None:
    u, cubic, lam = (laws.term(flow, "u", text) for text in ("u", "u**3", "lam"))
    best = laws.law([u], [0.1])
    nested = laws.law([u, cubic], [0.1, 0.0], score=1.0)
    rival = laws.law([lam], [0.2], score=3.0, misfit=1.2)
    twin = laws.law([cubic], [0.3], score=4.0, misfit=1.001)
    others = [laws.law([laws.parameter(flow, "q")], [0.3], score=s) for s in (9.0, 8.0)]
    found = alternatives(laws.discovery(best, nested, rival, twin, *others), flow)
    assert [other["delta_bic"] for other in found] == [3.0, 4.0, 1.0]
    assert [other["rival"] for other in found] == [True, True, False]
    assert found[0]["terms"] == [
        {"equation": "u", "term": "lam", "coefficient": 0.2, "window": None}
    ]
    names = ("lam**2", "lam**3", "u*lam")
    more = [laws.law([laws.term(flow, "u", name)], [0.3], score=5.0) for name in names]
    found = alternatives(laws.discovery(best, nested, rival, twin, *more, *others), flow)
    assert [other["rival"] for other in found] == [True] * 5


def test_a_law_that_is_nearly_as_good_is_listed_before_one_of_a_single_term(flow: System) -> None:
    u, cubic, lam = (laws.term(flow, "u", text) for text in ("u", "u**3", "lam"))
    best = laws.law([u, cubic, lam], [0.1, 0.2, 0.3])
    rivals = [laws.law([u, laws.parameter(flow, "q")], [0.1, 0.2], score=3.0)]
    near = laws.law([u, cubic], [0.1, 0.2], score=7.0)
    far = laws.law([u, lam], [0.1, 0.2], score=30.0)
    single = laws.law([u], [0.1], score=900.0)
    found = alternatives(laws.discovery(best, *rivals, near, far, single), flow)
    assert [other["delta_bic"] for other in found] == [3.0, 7.0, 900.0]
    more = [*rivals, laws.law([cubic, laws.parameter(flow, "q")], [0.1, 0.2], score=4.0)]
    found = alternatives(laws.discovery(best, *more, near, far, single), flow)
    assert [other["delta_bic"] for other in found] == [3.0, 4.0, 7.0]


def test_laws_have_the_same_readings_below_a_chi2_of_six(flow: System) -> None:
    # In χ², over 120 samples: 120·0.2² = 4.8 and 120·0.25² = 7.5.
    u, lam = laws.term(flow, "u", "u"), laws.term(flow, "u", "lam")
    for misfit, same in ((1.2, True), (1.25, False)):
        rival = laws.law([lam], [0.2], score=3.0, misfit=misfit)
        [other] = alternatives(laws.discovery(laws.law([u], [0.1]), rival), flow)
        assert other["same_as_best"] is same


def test_the_text_of_a_law_with_a_term_and_a_parameter(flow: System) -> None:
    law = laws.law([laws.term(flow, "u", "u"), laws.parameter(flow, "nu")], [-0.04, 0.01])
    text = law_text(terms_of_law(flow, law), flow)
    assert text.startswith("The simulation leaves out linear damping of internal energy, −0.0400")
    assert text.endswith("A parameter has a wrong value: nu is 0.1100 ± 0.0020, not 0.1.")
    assert "no missing term" in law_text(terms_of_law(flow, laws.law()), flow)


def test_smaller_laws_have_their_explained_share(flow: System) -> None:
    u, cubed, squared = (laws.term(flow, "u", text) for text in ("u", "u**3", "u**2"))
    path = [
        BestOfSize((), (), 900.0, 3.0),
        BestOfSize((u,), (-0.1,), 150.0, 1.5),
        BestOfSize((u, cubed), (-0.1, 0.02), 100.0, 1.0),
        BestOfSize((u, cubed, squared), (-0.1, 0.02, 0.0), 108.0, 0.99),
    ]
    [only] = smaller_laws(laws.discovery(laws.law([u, cubed], [-0.1, 0.02]), path=path), flow)
    assert only["terms"] == [{"equation": "u", "term": "u", "coefficient": -0.1, "window": None}]
    assert only["explained"] == pytest.approx((9 - 2.25) / (9 - 1))
    assert smaller_laws(laws.discovery(laws.law([u], [-0.1]), path=path), flow) == []
    assert smaller_laws(laws.discovery(laws.law(), path=path), flow) == []


def test_the_law_that_is_reported_is_looked_up_on_the_path(flow: System) -> None:
    """It is not the lowest score of the path: hypotheses are compared after the path."""
    u, cubed = laws.term(flow, "u", "u"), laws.term(flow, "u", "u**3")
    path = [
        BestOfSize((), (), 900.0, 3.0),
        BestOfSize((u,), (-0.1,), 150.0, 1.5),
        BestOfSize((u, cubed), (-0.1, 0.02), 100.0, 1.0),
    ]

    def on_path(*candidates: Candidate) -> int | None:
        values = [0.1] * len(candidates)
        return laws.discovery(laws.law(list(candidates), values), path=path).path_index

    assert on_path() == 0
    assert on_path(u) == 1
    assert on_path(cubed, u) == 2
    assert on_path(cubed) is None
    shape = box(Axis("x", 6.0, 32))
    [local] = restrict_to_window([u], shape.at((2.0, 0.5, 0.0)))
    assert on_path(local) is None
