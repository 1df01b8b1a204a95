"""Fitted parameters are told beside the law, and never as a part of it."""

from __future__ import annotations

from typing import Any

import pytest

from dashred.core.findings.input_schema import Input
from dashred.core.findings.law_schema import FittedParameter
from dashred.core.findings.schema import new_findings
from dashred.pipeline.api.tables import fitted_parameters_table
from dashred.reporting.page.html import notebook_html, page
from dashred.reporting.text.fitted_parameters import fitted_parameter_lines
from dashred.reporting.text.headline import headline
from dashred.reporting.text.improvement import improvements
from dashred.reporting.text.summary import summary

SOURCE = Input(
    config={"system": {"title": "Capacitor", "equations": {"q": "(e - q/C)/R"}}},
    config_sha256="c",
    recording_sha256="r",
    seed=0,
    versions={},
    library_size=None,
    splits=None,
)
R = FittedParameter(
    parameter="R",
    stated=2.7,
    spread=1.0,
    value=3.412,
    std=0.0521,
    ci95=[3.31, 3.514],
    aliases=[],
    exact=True,
    unit="ohm",
)
TERM: Any = {
    "equation": "q",
    "term": "q**3",
    "coefficient": -0.0251,
    "std": 0.0004,
    "ci95": [-0.0259, -0.0243],
    "inclusion": 0.98,
    "region": None,
    "effect": "cubic damping of charge",
    "says": "cubic damping of charge, (−0.0251 ± 0.0004)·q³ per unit time",
}
VALUE = "R = 3.41 ± 0.10 ohm (stated 2.7, spread 1)"
CLOSE = "It is 0.7 spreads from the stated value, and the recording determines it."


def found(*fitted: Any, verdict: Any = "nothing-missing", **changed: Any) -> Any:
    given = {"causes": [], "terms": [], **changed}
    return new_findings(SOURCE, verdict=verdict, fitted_parameters=fitted, **given)


def changed(**values: Any) -> Any:
    return R | values


@pytest.mark.parametrize(
    ("fitted", "line"),
    [
        (R, f"{VALUE}. {CLOSE}"),
        (changed(parameter="m"), f"{VALUE}. {CLOSE}".replace("R", "m")),
        (changed(exact=False), f"{VALUE[:-1]}; to first order). {CLOSE}"),
        (changed(aliases=["m"]), f"{VALUE}. {CLOSE} A change of m has the same effect."),
        (changed(aliases=["m", "k"]), f"{VALUE}. {CLOSE} A change of m or k has the same effect."),
        (changed(sensor="S1"), f"{VALUE}. {CLOSE} This calibrates the sensor S1."),
        (changed(episode="day 2"), f"{VALUE}. {CLOSE} This is the value in episode day 2."),
        (changed(input="e"), f"{VALUE}. {CLOSE} This is the delay of the input e."),
    ],
)
def test_a_value_stands_beside_what_was_stated(fitted: Any, line: str) -> None:
    assert fitted_parameter_lines(found(fitted)) == [line]


@pytest.mark.parametrize(
    ("value", "std", "told"),
    [
        (6.9, 0.05, "It is 4.2 spreads from the stated value, and the recording determines it."),
        (-1.5, 0.85, "It is 4.2 spreads from the stated value, and the recording determines it."),
        (
            3.4,
            0.95,
            "It is 0.7 spreads from the stated value, and the recording does not determine ",
        ),
        # Far from the stated value, although the interval is wide: a motor's time constant.
        (13.7, 1.6, "It is 11.0 spreads from the stated value, and the recording determines it."),
        (
            6.9,
            1.6,
            "It is 4.2 spreads from the stated value, and the recording does not determine ",
        ),
    ],
)
def test_the_distance_and_what_the_recording_determines(
    value: float, std: float, told: str
) -> None:
    [line] = fitted_parameter_lines(found(changed(value=value, std=std)))
    assert told in line


def test_without_a_unit_there_is_none() -> None:
    plain = {name: value for name, value in R.items() if name != "unit"}
    [line] = fitted_parameter_lines(found(plain))
    assert line == f"{VALUE}. {CLOSE}".replace(" ohm", "")


def test_the_summary_has_a_section_of_them() -> None:
    lines = summary(found(R, changed(parameter="k")), None, {}).splitlines()
    at = lines.index("Fitted parameters:")
    assert lines[at + 1 : at + 3] == [
        f"  {VALUE}. {CLOSE}",
        f"  {VALUE}. {CLOSE}".replace("R", "k"),
    ]
    assert lines[at - 1] == "" == lines[at + 3]
    assert "Fitted" not in summary(found(), None, {})


def test_the_page_has_a_section_and_its_equations_have_the_values() -> None:
    text = page(found(R, verdict="missing-term", terms=[TERM]), {}, "")
    assert f"<h2>Fitted parameters</h2>\n<p>{VALUE}. {CLOSE}</p>" in text
    assert f"with {VALUE}, fitted</div>" in text and f"<mark>{VALUE}" not in text
    assert f"with {VALUE}, fitted</div>" in notebook_html(found(R))
    assert "Fitted parameters" not in page(found(), {}, "")


def test_the_page_says_that_they_were_fitted_with_the_start() -> None:
    splits: Any = {"inputs": ["a"], "extra": [], "validate": [], "test": [], "time_end": 1.0}
    source: Any = SOURCE | {"splits": splits | {"note": None}}
    told = [
        "and the parameters that have a spread" in page(each | {"input": source}, {}, "")
        for each in (found(R), found())
    ]
    assert told == [True, False]


def test_if_nothing_else_is_missing_the_stated_simulation_is_not_said_to_agree() -> None:
    told = headline(found(R))
    assert told == (
        "The equations with the fitted parameter R = 3.41 ± 0.10 ohm explain the recording: these "
        "sensors show no missing term."
    )
    assert "with the 4 fitted parameters explain" in headline(found(*[R] * 4))
    for text in (summary(found(R), None, {}), page(found(R), {}, "")):
        assert "the simulation agrees" not in text
        assert "nothing is missing from the simulation" not in text
        assert "nothing-missing: the equations with the fitted parameters explain" in text
    assert headline(found()).startswith("The simulation agrees with the recording")
    assert "nothing is missing from the simulation" in summary(found(), None, {})


def test_another_cause_stands_beside_the_fitted_simulation() -> None:
    told = headline(found(R, verdict="initial-condition"))
    assert told.startswith("The simulation with the fitted parameters agrees with the recording")


def test_they_are_no_part_of_a_law() -> None:
    law = headline(found(R, verdict="missing-term", terms=[TERM]))
    assert law == headline(found(verdict="missing-term", terms=[TERM]))
    assert "R" not in law


def test_older_findings_have_none() -> None:
    old = found()
    del old["fitted_parameters"]
    assert summary(old, None, {}) == summary(found(), None, {})
    assert page(old, {}, "") == page(found(), {}, "")


def test_a_correction_of_parameters_alone_is_compared_with_what_was_stated() -> None:
    errors = {"simulation_same_start": 0.9, "simulation_refit": 0.1, "corrected": 0.1}
    findings = found(R)
    findings["fit"]["heldout_time"] = errors
    findings["fit"]["heldout_restarted"] = {"simulation_refit": 0.1, "corrected": 0.1}
    assert improvements(findings) == [
        "In the held-out time the error is 0.9 for the simulation from its nominal start, "
        "0.1 for the corrected simulation: 9 times smaller."
    ]
    assert "9 times smaller" in headline(findings)


def test_a_law_is_compared_with_the_simulation_with_fitted_parameters() -> None:
    findings = found(R, verdict="missing-term", terms=[TERM])
    findings["fit"]["heldout_time"] = {"simulation_refit": 0.4, "corrected": 0.1}
    [line] = improvements(findings)
    assert "0.4 for the simulation from its best start with the fitted parameters" in line
    assert line.endswith("4 times smaller.")


def test_the_table_of_fitted_parameters() -> None:
    [row] = fitted_parameters_table(found(R)).to_dict("records")
    assert (row["parameter"], row["value"], row["unit"]) == ("R", 3.412, "ohm")
    assert (row["low"], row["high"], row["stated"], row["spread"]) == (3.31, 3.514, 2.7, 1.0)
    assert fitted_parameters_table({}).empty
