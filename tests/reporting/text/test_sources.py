"""A localised source and a region that wraps around a ring, as text."""

from __future__ import annotations

from typing import Any

import pytest

from dashred.core.findings.law_schema import Region
from dashred.reporting.text.headline import headline
from dashred.reporting.text.regions import bounds, location, region_text
from dashred.reporting.text.sources import short_source_text, source, source_text

SOURCE: dict[str, Any] = {
    "equation": "c",
    "place": [8.1],
    "place_std": [0.05],
    "region": [{"axis": "x", "from": 7.66, "to": 8.57}],
    "period": 5.71,
    "period_std": 0.02,
    "begin": None,
    "begin_std": None,
    "strength": 0.162,
    "strength_std": 0.004,
    "share": 0.998,
    "times": [0.0, 1.0],
    "rates": [0.1, 0.2],
    "as_terms": True,
}
STEADY = SOURCE | {"period": None, "period_std": None}


def findings(**changed: Any) -> dict[str, Any]:
    """Findings of a source."""
    where = {"source": SOURCE, "forcing": None, "equation": {"c": 1.0}, "region": None} | changed
    system = {"axes": {"x": {"length": 12}}}
    return {
        "verdict": "outside-library",
        "causes": [{"kind": "outside-library", "probability": 1.0, "gain": 50.0}],
        "where": where,
        "terms": [],
        "fit": {},
        "input": {"config": {"system": system}},
    }


def test_a_pulsating_source() -> None:
    assert source_text(SOURCE, {"x": "m", "t": "s"}) == (
        "a source in the equation of c at x = 8.10 ± 0.10 m, between x = 7.66 and 8.57 m; it "
        "pulsates with a period of 5.71 ± 0.04 s. Its mean strength, integrated over space, is "
        "0.162 ± 0.008; it explains 100 % of the misfit beyond noise"
    )
    assert short_source_text(SOURCE) == (
        "a source in the equation of c near x = 8.1 that pulsates with a period of 5.71"
    )


def test_a_sink_that_begins_and_wraps_around_a_ring() -> None:
    region = [{"axis": "x", "from": 11.7, "to": 0.4}]
    sink = STEADY | {"strength": -0.2, "begin": 3.2, "begin_std": 0.1, "region": region}
    text = source_text(sink)
    assert text.startswith("a sink in the equation of c")
    assert "between x = 11.70 and 0.40 across the ends of the axis" in text
    assert "; it begins at time 3.20 ± 0.20" in text


def test_the_headline_and_the_summary_tell_the_source() -> None:
    found = findings()
    assert headline(found).startswith("The simulation lacks a source in the equation of c near")
    [line] = source(found)
    assert line.startswith("A source in the equation of c")


def test_without_a_source_the_largest_force_is_told() -> None:
    found = findings(source=None, forcing={"peak": [8.3]})
    assert source(found) == ["The force that the simulation lacks is largest near x = 8.3."]
    explained = found | {"causes": [{"kind": "missing-term", "probability": 1.0}]}
    assert source(explained) == []


@pytest.mark.parametrize(
    ("begin", "end", "short", "text"),
    [
        (5.42, 0.887, "for x > 5.42 or x < 0.887", "x > 5.420 or x < 0.887 (± 0.010)"),
        (1.0, 2.0, "for 1 < x < 2", "1.000 < x < 2.000 (± 0.010)"),
    ],
)
def test_a_region_that_wraps_around(begin: float, end: float, short: str, text: str) -> None:
    region: Region = {"axis": "x", "from": begin, "to": end, "std": 0.005}
    assert region_text(region) == short and bounds(region, {}) == text
    where = {"equation": {"u": 1.0}, "region": [region], "regime": None}
    assert location(where, {}) == [f"It acts in the equation of u, for {text}."]
