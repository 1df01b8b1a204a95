"""What the texts claim: only what held-out data support, and no p-values."""

import math
from typing import Any

import pytest

from dashred.core.findings.fit_schema import Comparison, Fit, errors_by_method
from dashred.core.findings.input_schema import Input
from dashred.core.findings.schema import new_findings
from dashred.reporting.page.html import page
from dashred.reporting.text.causes import cause_text
from dashred.reporting.text.headline import headline
from dashred.reporting.text.improvement import improvements
from dashred.reporting.text.summary import summary
from dashred.reporting.text.verdict import verdict_lines

SOURCE = Input(
    config={"system": {"title": "Ring", "equations": {"u": "lap(u)"}}},
    config_sha256="c",
    recording_sha256="r",
    seed=0,
    versions={},
    library_size=None,
    splits=None,
)
TERM: Any = {
    "equation": "u",
    "term": "u**3",
    "coefficient": -0.0251,
    "std": 0.0004,
    "ci95": [-0.0259, -0.0243],
    "inclusion": 0.98,
    "region": None,
    "effect": "cubic damping of u",
    "says": "cubic damping of u, (−0.0251 ± 0.0004)·u³ per unit time",
}
WHERE: Any = {
    "equation": {"u": 1.0},
    "region": None,
    "time": [0, 8],
    "regime": None,
    "sensors": [],
    "significance": 1e-40,
    "profile": {"times": [], "before": [], "after": []},
    "forcing": None,
}
WORSE = Comparison(
    data="test_sensors",
    before=0.21,
    after=0.52,
    difference=0.2263,
    error=0.052,
    samples=40,
    horizon=None,
    worse=True,
)
BETTER = Comparison(
    data="heldout_time",
    before=0.4,
    after=0.2,
    difference=-0.12,
    error=0.05,
    samples=16,
    horizon=None,
    worse=False,
)


def found(*comparisons: Comparison, **changed: Any) -> Any:
    fit = Fit(
        comparisons=list(comparisons),
        noise_std=None,
        noise_correlation=None,
        own_error=None,
        chi2=1.0,
        unexplained=0.0,
        misfit_at_test_sensors=None,
        test_sensors=errors_by_method(
            simulation_same_start=0.9, simulation_refit=0.21, corrected=0.52
        ),
        heldout_time=errors_by_method(
            simulation_same_start=0.8, simulation_refit=0.4, corrected=0.2
        ),
        heldout_restarted=errors_by_method(),
    )
    given: Any = {
        "fit": fit,
        "verdict": "unconfirmed",
        "causes": [{"kind": "missing-term", "probability": 0.98}],
        "where": WHERE,
        "terms": [TERM],
        "alternatives": [],
    }
    return new_findings(SOURCE, **given | changed)


def text_of(findings: Any) -> str:
    return "\n".join(verdict_lines(findings))


def test_an_unconfirmed_law_is_a_suggestion_with_the_comparison_that_failed() -> None:
    lines = verdict_lines(found(BETTER, WORSE))
    assert lines[:3] == [
        "Verdict: unconfirmed: an explanation fits the recording, but the held-out data contradict "
        "it.",
        "  At the test sensors the error is 0.52 with the suggested law, and 0.21 for the "
        "simulation from its best start. The mean squared error is larger by 0.23 (99 % "
        "interval: 0.17 to 0.28).",
        "  Suggested, but not confirmed: the simulation leaves out cubic damping of u, "
        "(−0.0251 ± 0.0004)·u³ per unit time.",
    ]
    shown = page(found(BETTER, WORSE), {}, "")
    assert lines[1].strip() in shown and "They are suggested, but not confirmed." in shown
    assert "suggested" not in text_of(found(BETTER, WORSE, verdict="missing-term")).lower()


def test_the_nearest_law_of_an_effect_outside_of_the_library_may_be_refuted() -> None:
    outside: Any = {
        "verdict": "outside-library",
        "causes": [{"kind": "outside-library", "gain": 9}],
    }
    told = found(BETTER, WORSE, **outside)
    assert "Suggested, but not confirmed: the simulation leaves out" in text_of(told)
    assert "the held-out data contradict" in headline(told)
    # Without a law there is nothing to refute.
    alone = text_of(found(BETTER, WORSE, terms=None, **outside))
    assert "suggested" not in alone.lower() and "only these sensors" not in alone


def test_the_nearest_law_is_called_so_and_whether_held_out_data_support_it() -> None:
    outside: Any = {
        "verdict": "outside-library",
        "causes": [{"kind": "outside-library", "gain": 9}],
    }
    told = found(BETTER, **outside)
    assert "In the nearest law, the simulation leaves out" in text_of(told)
    assert "support" not in headline(told)
    told["fit"]["heldout_time"]["corrected"] = 0.39
    assert "In the nearest law, which no held-out data support, the sim" in text_of(told)
    assert "which no held-out data support" in headline(told)
    # A fault that is fitted beside it is as uncertain; one of a sensor that no fit has used is not.
    fault = {"kind": "sensor-fault", "probability": 0.9, "says": "sensor a reads too high"}
    outside["causes"] += [fault | {"sensor": "a"}]
    assert "  In the nearest law, sensor a reads too high." in verdict_lines(found(**outside))
    told = found(**outside)
    told["input"] = SOURCE | {"splits": {"validate": [], "test": ["a"]}}
    assert "  Sensor a reads too high." in verdict_lines(told)
    # Of other verdicts it is said in a sentence.
    other = found(BETTER, verdict="missing-term")
    line = "No held-out data support this law: it does not reduce the error on any of them."
    assert line not in text_of(other)
    other["fit"]["heldout_time"]["corrected"] = 0.39
    assert f"  {line}" in verdict_lines(other)
    assert line not in text_of(found(BETTER, WORSE, verdict="unconfirmed"))
    # A law of the extended library is not only the nearest one.
    outside["causes"] = [{"kind": "outside-library", "probability": 0.9, "terms": ["u: sin(u)"]}]
    assert "nearest" not in text_of(found(BETTER, **outside))


def test_unconfirmed_faults_are_told_with_the_misfits_at_the_test_sensors() -> None:
    says = "the readings of sensor s08 wander"
    cause = {"kind": "sensor-fault", "probability": 0.98, "says": says}
    told = found(causes=[cause], terms=[], where=None)
    told["fit"]["misfit_at_test_sensors"] = {"s03": 8.61, "s07": None}
    lines = verdict_lines(told)
    assert lines[1:3] == [
        "  If only these sensors were faulty, the simulation would agree with the sensors that no "
        "fit has used, unless one of them is faulty too and not next to a faulty sensor of the "
        "fit. This is not the case: an effect that the simulation lacks is more likely. Errors in "
        "standard deviations of the fit's residuals: 8.61 at s03, beyond all bounds at s07.",
        "  Suggested, but not confirmed: the readings of sensor s08 wander.",
    ]
    assert headline(told) == (
        "There is no confirmed result: faulty sensors would explain the readings used in the fit, "
        "but held-out data disagree with the simulation, too."
    )
    told["fit"]["unconfirmed"] = "no-better-than-mean"
    assert verdict_lines(told)[1] == (
        "  If only these sensors were faulty, the simulation would predict the others better than "
        "their mean does. This is not the case: an effect that the simulation lacks is more likely."
    )
    confirmed = verdict_lines(told | {"verdict": "sensor-fault"})
    assert "  The readings of sensor s08 wander." in confirmed


@pytest.mark.parametrize("after", [math.inf, None], ids=["in memory", "in the file"])
def test_a_law_that_makes_a_held_out_run_blow_up_is_told_without_an_error_bar(
    after: float | None,
) -> None:
    worse: Any = WORSE | {"data": "heldout_episode", "after": after, "error": None}
    told = found(worse)
    assert "In the held-out episode the error is beyond all bounds with the suggested" in text_of(
        told
    )
    assert headline(told).endswith("the simulation diverges in an episode not used in any fit.")


def test_the_headline_of_an_unconfirmed_law_names_the_data_that_contradict_it() -> None:
    late = WORSE | {"data": "heldout_time"}
    told = headline(found(BETTER | {"data": "test_sensors"}, late))
    assert told == (
        "There is no confirmed result: the held-out data contradict the best law (cubic damping of "
        "u). With this correction, the error in the held-out time is 2.5 times "
        "larger."
    )


def test_a_run_that_diverges_has_no_number_but_is_told() -> None:
    lost: Any = WORSE | {"after": None, "difference": 80.0, "error": 9.0}
    assert "the error is beyond all bounds with the suggested law" in text_of(found(lost))


def test_where_the_start_is_the_correction_it_is_compared_with_the_nominal_start() -> None:
    start = found(verdict="initial-condition", terms=[], where=None, causes=[])
    start["fit"]["heldout_restarted"] = errors_by_method(simulation_refit=0.3, corrected=0.3)
    [test, late, restarted] = improvements(start)
    assert restarted.endswith("0.3 for the corrected simulation: no difference.")
    assert test == (
        "At the test sensors the error is 0.9 for the simulation from its nominal start, 0.21 for "
        "the simulation from its best start under the stated prior, 0.52 for the corrected "
        "simulation: 1.7 times smaller."
    )
    assert late.endswith("4 times smaller.")
    assert headline(start).endswith(
        "With this correction, the error at sensors not used in any fit is 1.7 times smaller."
    )


def test_a_factor_is_against_the_better_of_both_starts() -> None:
    law = found(verdict="missing-term")
    law["fit"]["test_sensors"] = errors_by_method(
        simulation_same_start=0.42, simulation_refit=5.54, corrected=0.21
    )
    [test, *_] = improvements(law)
    assert test == (
        "At the test sensors the error is 0.42 for the simulation from the same start, 5.54 for "
        "the simulation from its best start, 0.21 for the corrected simulation: 2 times smaller."
    )
    assert headline(law).endswith("at sensors not used in any fit is 2 times smaller.")


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        (math.inf, 0.2, "Without this correction the simulation diverges in the held-out time."),
        (0.4, math.inf, "With this correction the simulation diverges in the held-out time."),
        (math.inf, math.inf, "leaves out cubic damping of u."),
    ],
)
def test_a_run_that_diverges_has_no_factor(before: float, after: float, told: str) -> None:
    law = found(verdict="missing-term")
    law["fit"]["test_sensors"] = errors_by_method()
    law["fit"]["heldout_time"] = errors_by_method(simulation_refit=before, corrected=after)
    assert headline(law).endswith(told)


def test_where_a_sensor_is_the_correction_the_headline_tells_the_gain() -> None:
    fault: Any = {
        "kind": "sensor-fault",
        "probability": 1.0,
        "sensor": "s3",
        "fault": "bias",
        "value": 0.3,
        "std": 0.01,
        "from": None,
        "reads": "u",
        "axis": None,
        "episode": None,
    }
    sensor = found(verdict="sensor-fault", terms=[], where=None, causes=[fault])
    told = headline(sensor)
    assert "sensor s3 has a bias of 0.300 ± 0.020" in told
    assert told.endswith("in the held-out time is 2 times smaller.")


def test_a_correction_that_predicts_no_better_than_a_constant_is_told_as_such() -> None:
    told = found(verdict="missing-term")
    told["fit"]["test_sensors"] = errors_by_method()
    told["fit"]["heldout_time"] = errors_by_method(simulation_refit=2e4, corrected=1.36)
    assert headline(told).endswith(
        " times smaller, but it still exceeds the error of a constant prediction."
    )
    told["fit"]["heldout_time"] = errors_by_method(simulation_refit=2e4, corrected=0.9)
    assert headline(told).endswith(" times smaller.")


def test_a_chaotic_system_is_told_up_to_the_time_at_which_its_runs_are_lost() -> None:
    cut: Any = BETTER | {"horizon": 12.345678, "before": 0.6, "after": 0.1}
    told = improvements(found(cut, verdict="missing-term", units={"t": "s"}))[1]
    assert told.endswith(
        "The error of a run grows until the run is no longer predictive. In the first 12.3 s of a "
        "run the error is 0.6 from the best start and 0.1 with the correction: 6 times smaller."
    )
    only = found(cut, verdict="missing-term")
    only["fit"]["test_sensors"] = errors_by_method()
    assert headline(only).endswith("in the held-out time is 6 times smaller.")


def test_data_for_which_both_chaotic_runs_are_lost_support_nothing() -> None:
    again: Any = BETTER | {"data": "heldout_restarted", "before": 1.2, "after": 0.1}
    told = found(again, verdict="missing-term")
    told["fit"]["test_sensors"] = errors_by_method()
    told["fit"]["heldout_restarted"] = errors_by_method(simulation_refit=1.2, corrected=0.1)
    [late, restarted] = improvements(told)
    assert late.endswith(": this chaotic system is not predictable that far ahead.")
    assert restarted.endswith("12 times smaller.")
    assert headline(told).endswith("from a state fitted just before it, is 12 times smaller.")
    # A law that alone makes the run diverge is not a matter of chaos.
    told["fit"]["heldout_time"] = errors_by_method(simulation_refit=0.3, corrected=math.inf)
    assert improvements(told)[0].endswith(": the run with the law diverges.")
    assert headline(told).endswith("the simulation diverges in the held-out time.")


@pytest.mark.parametrize("verdict", ["missing-term", "ambiguous", "outside-library"])
def test_no_p_value_is_printed(verdict: str) -> None:
    told = found(verdict=verdict)
    for text in (headline(told), text_of(told), page(told, {}, "")):
        assert "1e−40" not in text and "1e-40" not in text and "p <" not in text


def test_further_supported_terms_are_listed_after_the_law() -> None:
    more: Any = [
        {"equation": "u", "term": "u", "coefficient": 0.0249, "window": None, "region": None},
        {"equation": None, "term": "nu", "coefficient": 0.015, "window": None, "region": None},
    ]
    told = found(verdict="missing-term", also_supported=more)
    line = "Also supported: u: 0.0249·u, nu +0.015; the forecast does not need these terms."
    assert line in text_of(told) and line in page(told, {}, "")
    alone = found(verdict="missing-term", also_supported=more[:1])
    assert "does not need this term." in text_of(alone)
    assert "Also supported" not in text_of(found(verdict="missing-term"))


@pytest.mark.parametrize(
    "changed",
    [
        {"verdict": "unconfirmed"},
        {"verdict": "outside-library", "causes": [{"kind": "outside-library", "gain": 9.0}]},
        {"verdict": "outside-library", "causes": [{"kind": "outside-library", "residual": 0.3}]},
    ],
)
def test_terms_beside_a_law_that_does_not_explain_are_not_called_supported(changed: Any) -> None:
    more: Any = [
        {"equation": "u", "term": "u", "coefficient": 0.0249, "window": None, "region": None}
    ]
    text = text_of(found(also_supported=more, **changed))
    assert "Further terms lower the misfit, but are not confirmed: u: 0.0249·u." in text
    assert "supported" not in text


@pytest.mark.parametrize(
    ("cause", "told"),
    [
        # A quarter of the misfit is noise, and the given law leaves four times as much.
        (
            {"gain": 250.0, "unexplained": 0.75, "misfit": 4.0},
            "the best law with a few terms leaves residuals of 4 times the noise, and the evidence "
            "for a force beyond it is 250",
        ),
        (
            {"gain": 9.0, "unexplained": 0.1, "misfit": 0.9},
            "the evidence for a force beyond the best law with a few terms is 9",
        ),
        (
            {"gain": 9.0, "unexplained": 0.75, "misfit": math.inf},
            "the best law with a few terms leaves residuals of 2 times the noise, and the evidence "
            "for a force beyond it is 9",
        ),
        ({"gain": 9.0}, "the evidence for a force beyond the best law with a few terms is 9"),
    ],
)
def test_what_the_best_law_leaves_is_told_and_not_what_no_law_can_do(cause: Any, told: str) -> None:
    whole: Any = {"kind": "outside-library", "probability": None} | cause
    assert cause_text(whole) == told
    text = text_of(found(verdict="outside-library", causes=[whole]))
    assert "no law with a few terms from the library explains the recording" in text
    assert "cannot express" not in text


def test_few_held_out_samples_are_called_little_evidence() -> None:
    told = found(BETTER, verdict="missing-term")
    told["fit"]["held_out_samples"] = {"test_sensors": 40, "heldout_time": 2}
    [first, second] = improvements(told)
    assert "evidence" not in first
    assert second.endswith("2 times smaller. 2 held-out samples are little evidence.")
    text = summary(told, None, {})
    assert "Test sensors, not used in any fit (40 samples): RMSE" in text
    assert "Held-out time, the end of the recording (2 samples): RMSE" in text
    shown = page(told, {}, "")
    assert "test sensors (40 samples)" in shown and "held-out time (2 samples)" in shown
    told["fit"]["test_sensors"] = errors_by_method()
    assert headline(told).endswith("in the held-out time is 2 times smaller, in 2 samples only.")


def test_a_fault_beside_the_nearest_law_is_told_as_such() -> None:
    fault = {
        "kind": "sensor-fault",
        "probability": 0.93,
        "fault": "bias",
        "sensor": "s1",
        "value": 3.0,
        "std": None,
        "reads": "u",
        "from": None,
        "axis": None,
        "episode": None,
    }
    outside = {"kind": "outside-library", "probability": 0.93}
    told = found(verdict="outside-library", causes=[outside, fault])
    assert "Under the nearest law, a sensor is faulty: sensor s1 has a bias of 3." in headline(told)
    lawless = told | {"terms": [], "causes": [outside | {"gain": 90.0}, fault]}
    assert "Under the nearest explanation, a sensor is faulty: sensor s1" in headline(lawless)
    law = told | {"verdict": "missing-term"}
    assert "A sensor is faulty: sensor s1 has a bias of 3." in headline(law)


@pytest.mark.parametrize("enough", [None, {"x": 96}])
def test_a_simulation_that_blows_up_at_doubled_resolution(enough: dict[str, int] | None) -> None:
    cause: Any = {
        "kind": "unresolved-numerics",
        "probability": None,
        "doubling_error": 0.05,
        "limit": 0.01,
        "points": {"x": 48},
        "enough": enough,
    }
    text = cause_text(cause)
    assert text is not None and "changes a sensor trace by 5.0 %" in text
    assert ("96 points along x" in text) == (enough is not None)
    cause["doubling_error"] = math.inf
    text = cause_text(cause)
    assert text is not None and "blows up" in text and "inf" not in text
