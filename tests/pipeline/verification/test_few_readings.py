"""A law with nearly as many coefficients as readings is not proved by them."""

from __future__ import annotations

import pytest

from dashred.core.findings.cause_schema import Verdict
from dashred.pipeline.verification.few_readings import FEWEST_READINGS, with_enough_readings
from dashred.reporting.text.improvement import contradictions, is_scant
from dashred.reporting.text.verdict import meaning


@pytest.mark.parametrize("verdict", ["missing-term", "parameter"])
def test_a_law_needs_several_readings_for_each_coefficient(verdict: Verdict) -> None:
    enough = 4 * FEWEST_READINGS + 2
    assert with_enough_readings(verdict, 4, enough, 2) == verdict
    assert with_enough_readings(verdict, 4, enough - 1, 2) == "unconfirmed"


@pytest.mark.parametrize("verdict", ["nothing-missing", "sensor-fault", "ambiguous"])
def test_a_verdict_without_a_firm_law_stays(verdict: Verdict) -> None:
    assert with_enough_readings(verdict, 4, 8, 2) == verdict


def test_the_report_says_that_the_readings_are_too_few() -> None:
    fit = {"comparisons": [{"worse": False}], "readings": 22, "start_values": 2}
    findings = {"verdict": "unconfirmed", "terms": [{}] * 4, "fit": fit}
    assert is_scant(findings)
    assert "too few to prove it" in meaning(findings)
    [why] = contradictions(findings)
    assert "4 coefficients and 2 start values were fitted to 22 readings" in why
    contradicted = findings | {"fit": fit | {"comparisons": [{"worse": True}]}}
    assert not is_scant(contradicted)
    assert "contradict" in meaning(contradicted)
