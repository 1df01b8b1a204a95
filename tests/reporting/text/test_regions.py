"""Regions as text, with the errors of their edges."""

from dashred.core.findings.law_schema import Region
from dashred.reporting.text.regions import bounds, region_text

INSIDE: Region = {"axis": "x", "from": 1.2, "to": 3.4, "std": 0.05}
CROSSING: Region = {"axis": "x", "from": 5.4, "to": 0.9, "std": 0.05}


def test_a_region_inside_the_axis_is_one_interval() -> None:
    assert region_text(INSIDE, {"x": "m"}) == "for 1.2 < x < 3.4 m"
    assert bounds(INSIDE, {"x": "m"}) == "1.20 < x < 3.40 m (± 0.10)"


def test_a_region_that_crosses_the_end_of_a_ring_is_written_in_two_parts() -> None:
    assert region_text(CROSSING, {"x": "m"}) == "for x > 5.4 or x < 0.9 m"
    assert bounds(CROSSING, {"x": "m"}) == "x > 5.40 or x < 0.90 m (± 0.10)"


def test_an_edge_is_written_like_other_numbers() -> None:
    gate: Region = {"field": "v", "below": -4027.3, "std": 400.0}
    assert region_text(gate) == "for v < −4030"
    assert bounds(gate, {}) == "v < −4000 (± 800)"
