"""Findings of earlier releases are read with the keys of this one."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.core.findings.findings import write_json_atomic
from dashred.core.findings.law_schema import Region
from dashred.evaluation.twins.findings_reader import read_findings, region_of_text


@pytest.mark.parametrize(
    ("text", "region"),
    [
        (None, None),
        ("for 1.5 < x < 2.5", {"axis": "x", "from": 1.5, "to": 2.5}),
        ("for -1e-05 < x < 2.5 m", {"axis": "x", "from": -1e-5, "to": 2.5}),
        ("for t > 11 s", {"axis": "t", "from": 11.0}),
        ("for u > 0.6", {"field": "u", "above": 0.6}),
        ("for u < -0.6 m/s", {"field": "u", "below": -0.6}),
    ],
)
def test_the_region_of_an_alternative_was_a_text(text: str | None, region: Region | None) -> None:
    assert region_of_text(text) == region


def test_old_findings_get_the_current_names_and_new_ones_are_read_as_they_are(
    tmp_path: Path,
) -> None:
    errors = {"before": 0.4, "before_refit": 0.3, "after": 0.1, "shred": 0.2}
    term = {"equation": "u", "term": "u", "coefficient": 1.0, "region": "for t > 11 s"}
    old = {"fit": {"test_sensors": errors}, "alternatives": [{"terms": [term]}], "smaller": None}
    write_json_atomic(tmp_path / "findings.json", old)
    found = read_findings(tmp_path)
    names = {"simulation_same_start", "simulation_refit", "corrected", "shred"}
    assert found["fit"]["test_sensors"].keys() == names
    assert found["alternatives"][0]["terms"][0]["window"] == {"axis": "t", "from": 11.0}
    write_json_atomic(tmp_path / "findings.json", found)
    assert read_findings(tmp_path) == found
