"""A wrong boundary condition is told in plain words."""

from __future__ import annotations

import pytest

from dashred.core.findings.law_schema import ParameterChange
from dashred.reporting.text.parameters import parameter_text, short_parameter_text


@pytest.mark.parametrize(("change", "way"), [(1.288, "higher"), (-1.288, "lower")])
def test_an_offset_names_the_field_and_the_end(change, way):
    found: ParameterChange = {
        "equation": None,
        "parameter": "T_left_offset",
        "term": "T_left_offset",
        "from": 0.0,
        "to": change,
        "coefficient": change,
        "std": 0.05,
        "ci95": [change - 0.1, change + 0.1],
        "aliases": [],
        "inclusion": 1.0,
        "region": None,
        "exact": True,
        "meaning": "value of T at the left end",
    }
    end = f"{way} than stated (T_left_offset)"
    assert parameter_text(found) == f"the value of T at the left end is 1.29 ± 0.10 {end}"
    assert short_parameter_text(found) == f"the value of T at the left end is 1.29 {end}"
