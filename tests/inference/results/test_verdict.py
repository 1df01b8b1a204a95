"""The verdict of each kind of law, and of a search that did not converge."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from dashred.core.findings.cause_schema import NONE_OF_THESE
from dashred.inference.fit.law import SensorFault
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.fit.selection.nested_fits import RoomLeft
from dashred.inference.results.verdict import unexplained_share, verdict
from dashred.physics.system import System
from dashred.physics.window import Window, gate
from dashred.reporting.text.causes import cause_text
from tests import laws

CERTAIN = 1 - NONE_OF_THESE


@pytest.fixture(scope="module")
def flow(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("flow"))


def test_each_kind_of_law_has_its_verdict(flow: System) -> None:
    u, nu = laws.term(flow, "u", "u"), laws.parameter(flow, "nu")
    expected = {
        "nothing-missing": laws.law(),
        "missing-term": laws.law([u, nu], [0.1, 0.1]),
        "parameter": laws.law([nu], [0.1]),
    }
    for kind, best in expected.items():
        found, causes = verdict(laws.discovery(best))
        assert found == causes[0]["kind"] == kind
        assert causes[0]["probability"] == pytest.approx(CERTAIN)
    [cause, *_] = verdict(laws.discovery(expected["parameter"]))[1]
    assert cause["parameter"] == ["nu"] and cause["where"] == {"equations": ["lam", "u"]}


def test_a_sensor_and_the_start_may_be_the_cause(flow: System) -> None:
    fault = SensorFault("drift", "s03", 0.0123, 0.0011, None)
    found, causes = verdict(laws.discovery(laws.law(faults=[fault]), laws.law(score=50.0)))
    assert found == causes[0]["kind"] == "sensor-fault"
    assert causes[0]["sensor"] == "s03"
    assert cause_text(causes[0]) == "sensor s03 drifts by 0.012 ± 0.002 per unit time"
    found, causes = verdict(laws.discovery(laws.law(widened=3.0), laws.law(score=50.0)))
    assert found == causes[0]["kind"] == "initial-condition" and causes[0]["start"] == 3.0
    far = laws.law(widened=6.0, score=2.0)
    assert verdict(laws.discovery(laws.law(widened=3.0), far))[0] == "initial-condition"
    # Both may be true: the law comes first, and both are causes.
    both = laws.law([laws.term(flow, "u", "u")], [1.0], faults=[fault])
    found, causes = verdict(laws.discovery(both, laws.law(score=50.0)))
    assert [cause["kind"] for cause in causes[:2]] == ["missing-term", "sensor-fault"]
    assert found == "missing-term" and causes[1]["sensor"] == "s03"
    assert causes[0]["probability"] == causes[1]["probability"]
    # The law is probable and the fault is not, if the law is nearly as good without it.
    alone = laws.law([laws.term(flow, "u", "u")], [1.0], score=1.0)
    _, [law, doubtful, *_] = verdict(laws.discovery(both, alone, laws.law(score=50.0)))
    assert law["probability"] == pytest.approx(CERTAIN)
    assert doubtful["kind"] == "sensor-fault"
    assert doubtful["probability"] == pytest.approx(CERTAIN / (1 + math.exp(-0.5)))
    # Either of two causes of different kinds may be the right one.
    other = laws.law([laws.term(flow, "u", "u")], [1.0], score=3.0)
    assert verdict(laws.discovery(laws.law(faults=[fault]), other))[0] == "ambiguous"


def test_an_effect_beyond_the_best_law_is_outside_the_library(
    flow: System,
) -> None:
    best = laws.law([laws.term(flow, "u", "u")], [0.1])
    assert verdict(laws.discovery(best, forcing_gain=3.0))[0] == "missing-term"
    found, [outside, nearest, *_] = verdict(laws.discovery(best, forcing_gain=30.0))
    assert found == outside["kind"] == "outside-library"
    # A forcing is not a law, so it has no share of the probability of the laws.
    assert (
        outside["probability"] is None and outside["gain"] == 30.0 and "unexplained" not in outside
    )
    [outside, *_] = verdict(laws.discovery(best, forcing_gain=30.0), 0.83)[1]
    assert (outside["unexplained"], outside["misfit"]) == (0.83, best.chi2)
    assert nearest["terms"] == ["u: u"]


def test_an_extended_law_is_outside_the_library(flow: System) -> None:
    term = replace(laws.term(flow, "u", "sin(2*u)"), is_extended=True)
    best = laws.law([term], [0.1])
    found, [cause, *_] = verdict(laws.discovery(best, laws.law(score=50.0)))
    assert found == cause["kind"] == "outside-library"
    assert cause["terms"] == ["u: sin(2*u)"] and "extended library" in str(cause_text(cause))
    # If a law of the library is as good, the verdict is ambiguous.
    near = laws.law([laws.term(flow, "u", "u")], [0.1], score=3.0)
    assert verdict(laws.discovery(best, near))[0] == "ambiguous"
    # Several waves may be rivals; all are outside the library.
    wave = replace(laws.term(flow, "lam", "cos(2*u)"), is_extended=True)
    found, [cause, *_] = verdict(laws.discovery(best, laws.law([wave], [0.1], score=3.0)))
    assert found == "outside-library" and cause["probability"] == pytest.approx(CERTAIN)


def test_a_rival_makes_it_ambiguous_and_the_classes_share_the_probability(flow: System) -> None:
    u, cubic, nu = (
        laws.term(flow, "u", "u"),
        laws.term(flow, "u", "u**3"),
        laws.parameter(flow, "nu"),
    )
    best, other = laws.law([u], [0.1]), laws.law([cubic], [0.1], score=5.0)
    rival = laws.law([nu], [0.1], score=4.0)
    found, causes = verdict(laws.discovery(best, rival, other))
    assert found == "ambiguous"
    assert [cause["kind"] for cause in causes] == ["missing-term", "parameter", "nothing-missing"]
    weights = (1 + 0.082085, 0.135335)
    assert causes[0]["probability"] == pytest.approx(CERTAIN * weights[0] / sum(weights), rel=1e-4)
    assert causes[0]["terms"] == ["u: u"] and causes[0]["where"] == {"equations": ["u"]}
    assert sum(cause["probability"] or 0.0 for cause in causes) == pytest.approx(CERTAIN)


def test_a_larger_law_of_an_exhausted_search_is_no_rival(flow: System) -> None:
    u, cubic = laws.term(flow, "u", "u"), laws.term(flow, "u", "u**3")
    both = laws.law([u, cubic], [0.1, 0.0], score=2.0)
    best = laws.law([u], [0.1])
    assert verdict(laws.discovery(best, both))[0] == "missing-term"
    assert verdict(laws.discovery(best, both, is_search_complete=False))[0] == "ambiguous"


def test_a_windowed_term_is_no_rival_of_its_parameter(
    flow: System,
) -> None:
    u = laws.term(flow, "u", "u")
    somewhere = replace(u, window=Window(gate("u", 1), (1.5, 0.1)))
    larger = laws.law([somewhere], [0.1], score=3.0)
    nu = laws.parameter(flow, "nu")
    assert verdict(laws.discovery(laws.law([nu], [0.1]), larger))[0] == "ambiguous"
    same = laws.law([replace(nu, replaces=(u.key,))], [0.1])
    assert verdict(laws.discovery(same, larger))[0] == "parameter"
    assert verdict(laws.discovery(same, larger, is_search_complete=False))[0] == "ambiguous"


def test_an_incomplete_horizon_has_not_converged(flow: System) -> None:
    best = laws.law([laws.term(flow, "u", "u")], [0.1])
    found, causes = verdict(laws.discovery(best, is_horizon_complete=False))
    assert found == "not-converged"
    [cause] = causes
    assert "the first 40 of 40 samples" in str(cause_text(cause)) and "terms" not in cause


@pytest.mark.parametrize(("chi2", "kind"), [(1.4, "missing-term"), (1.6, "not-converged")])
def test_a_misfit_above_that_of_all_candidates_has_not_converged(
    flow: System, chi2: float, kind: str
) -> None:
    best = laws.law([laws.term(flow, "u", "u")], [0.1], chi2=chi2)
    assert verdict(laws.discovery(best, free_chi2=1.0))[0] == kind


@pytest.mark.parametrize(
    ("chi2", "decrease", "chance", "kind"),
    [
        (0.9, 0.1, 0.4, "missing-term"),
        (1.1, 0.1, 0.4, "not-converged"),
        (0.9, 1.5, 0.4, "not-converged"),
        (0.9, 0.1, 0.01, "not-converged"),
    ],
)
def test_a_fit_within_the_noise_has_converged_if_nothing_significant_is_left(
    flow: System, chi2: float, decrease: float, chance: float, kind: str
) -> None:
    best = laws.law([laws.term(flow, "u", "u")], [0.1], chi2=chi2)
    discovery = replace(laws.discovery(best, free_chi2=0.3), room_left=RoomLeft(decrease, chance))
    assert verdict(discovery)[0] == kind
    assert verdict(replace(discovery, room_left=None))[0] == "not-converged"


def test_a_law_whose_fit_has_ended_is_not_told_as_unfitted(flow: System) -> None:
    best = laws.law([laws.term(flow, "u", "u")], [0.1], chi2=0.9)
    stuck = laws.discovery(best, free_chi2=0.3)
    text = {
        decrease: cause_text(verdict(replace(stuck, room_left=RoomLeft(decrease, 0.01)))[1][0])
        for decrease in (0.1, 1.5)
    }
    assert "ended with a misfit of 0.9" in str(text[0.1]) and "of 1 %" in str(text[0.1])
    assert "no sparse law was fitted to convergence" in str(text[1.5])


@pytest.mark.parametrize("widened", [1.0, 3.0])
def test_twice_the_noise_without_a_law_has_not_converged(flow: System, widened: float) -> None:
    lawless = laws.law(widened=widened)
    kind = "nothing-missing" if widened == 1 else "initial-condition"
    for left in (None, 0.0, 0.74):
        assert verdict(laws.discovery(lawless), left)[0] == kind
    found, [cause] = verdict(laws.discovery(lawless), 0.83)
    assert found == cause["kind"] == "not-converged" and "83 %" in str(cause_text(cause))
    # A law, a fault or a free forcing has its verdict, whatever share is unexplained.
    law = laws.law([laws.term(flow, "u", "u")], [0.1])
    assert verdict(laws.discovery(law), 0.83)[0] == "missing-term"
    fault = laws.law(faults=[SensorFault("drift", "s03", 0.0123, 0.0011, None)])
    assert verdict(laws.discovery(fault), 0.83)[0] == "sensor-fault"
    assert verdict(laws.discovery(lawless, forcing_gain=30.0), 0.83)[0] == "outside-library"


def test_a_law_that_leaves_large_residuals_is_only_the_nearest(flow: System) -> None:
    discovery = laws.discovery(laws.law([laws.term(flow, "u", "u")], [0.1]))
    found, [outside, nearest, *_] = verdict(discovery, 0.83, residual=0.25)
    assert found == outside["kind"] == "outside-library" and outside["probability"] is None
    assert "0.25 standard deviations" in str(cause_text(outside))
    assert "83 %" in str(cause_text(outside)) and nearest["terms"] == ["u: u"]
    # Noise that is stated or visible may be as large, and real systems leave small residuals.
    assert verdict(discovery, 0.5, residual=0.25)[0] == "missing-term"
    assert verdict(discovery, 0.99, residual=0.05)[0] == "missing-term"
    assert verdict(discovery, None, residual=0.25)[0] == "missing-term"
    # Many terms imitate what no term expresses.
    several = laws.law([laws.term(flow, "u", text) for text in ("u", "u**2", "u**3")], [0.1] * 3)
    assert verdict(laws.discovery(several), 0.83, residual=0.05)[0] == "outside-library"
    assert verdict(laws.discovery(several), 0.7, residual=0.05)[0] == "missing-term"
    # Ten times the noise, and a tenth of the trace.
    assert verdict(discovery, 0.995, residual=0.12)[0] == "outside-library"
    assert verdict(discovery, 0.98, residual=0.12)[0] == "missing-term"


@pytest.mark.parametrize(("misfit", "further", "kind"), [
    (1.24, 2, "outside-library"), (1.24, 0, "missing-term"), (0.98, 2, "missing-term"),
])  # fmt: skip
def test_a_part_of_a_larger_law_has_to_leave_noise_alone(
    flow: System, misfit: float, further: int, kind: str
) -> None:
    told = replace(laws.law([laws.term(flow, "u", "u")], [0.1]), chi2=misfit)
    beside = tuple((laws.term(flow, "u", f"u**{power}"), 0.1) for power in range(2, 2 + further))
    discovery = replace(laws.discovery(told), also_supported=beside, free_chi2=misfit)
    found, causes = verdict(discovery)
    assert found == kind
    if found == "outside-library":
        assert causes[0]["probability"] is None and causes[1]["terms"] == ["u: u"]
        assert "1.24 times the mean squared misfit" in str(cause_text(causes[0]))
        assert "2 further terms" in str(cause_text(causes[0]))


def test_the_unexplained_share_is_relative_to_the_stated_noise() -> None:
    seen = torch.ones(10, 2, dtype=torch.bool)
    found = NoiseModel(torch.tensor([0.2, 0.2]).double(), torch.zeros(2).double(), seen)
    assert unexplained_share(torch.tensor([0.1, 0.1]), found) == pytest.approx(0.75)
    assert unexplained_share(torch.tensor([0.2, 0.2]), found) == pytest.approx(0.0)
    assert unexplained_share(torch.tensor([0.4, 0.4]), found) == 0.0
    assert unexplained_share(None, found) is None
    seen[:, 1] = False
    half = NoiseModel(found.std, found.correlation, seen)
    assert unexplained_share(torch.tensor([0.2, 0.01]), half) == pytest.approx(0.0)
