"""Where a law acts, as text: ``for 10.1 < x < 16.0 m``, ``u > 1.76 (…)``.

A region that crosses the end of a periodic axis is written in two parts: ``x > 5.4 or x < 0.9``.
"""

from collections.abc import Mapping
from typing import Any

from dashred.core.findings.law_schema import ActiveStates, Region
from dashred.core.formatting import Z95, joined, number, percent, rounded
from dashred.core.units import NO_UNITS, with_unit


def region_text(region: Region, units: Mapping[str, str] = NO_UNITS) -> str:
    """Return a region without the errors of its edges: ``for t > 11 s``."""
    of = region.get("axis") or region["field"]
    unit = units.get(of)
    if "to" in region:
        begin, end = _short(region["from"]), with_unit(_short(region["to"]), unit)
        return f"for {_between(of, begin, end, is_split=region['from'] > region['to'])}"
    below = "below" in region
    edge = region["below"] if below else region["from"] if "from" in region else region["above"]
    return f"for {of} {'<' if below else '>'} {with_unit(_short(edge), unit)}"


def _short(edge: float) -> str:
    """Return an edge with three digits: ``−4030``."""
    return number(float(f"{edge:.3g}"))


def bounds(region: Region, units: Mapping[str, str]) -> str:
    """Return a region with the errors of its edges: ``10.1 < x < 16.0 m (± 0.1)``."""
    of, half_width = region.get("axis") or region["field"], Z95 * region["std"]
    unit = units.get(of)
    if "to" in region:
        begin, _ = rounded(region["from"], half_width)
        end, error = rounded(region["to"], half_width)
        is_split = region["from"] > region["to"]
        return f"{_between(of, begin, with_unit(end, unit), is_split=is_split)} (± {error})"
    if "below" in region:
        place, error = rounded(region["below"], half_width)
        return f"{of} < {with_unit(place, unit)} (± {error})"
    place, error = rounded(region["from"] if "from" in region else region["above"], half_width)
    return f"{of} > {with_unit(place, unit)} (± {error})"


def _between(of: str, begin: str, end: str, *, is_split: bool) -> str:
    return f"{of} > {begin} or {of} < {end}" if is_split else f"{begin} < {of} < {end}"


def states_text(states: ActiveStates, units: Mapping[str, str], *, in_space: bool) -> str:
    """Return the states in which a law acts: ``u > 1.76 (3 % of space and time, …)``."""
    field = states["field"]
    label = f"|{field}|" if states["magnitude"] else field
    sign, threshold = (">", states["above"]) if "above" in states else ("<", states["below"])
    value, _ = rounded(threshold, states["precision"])
    domain = "of space and time" if in_space else "of the time"
    carries = f"({percent(states['share'])} {domain}, {percent(states['carried'])} of the effect)"
    return f"{label} {sign} {with_unit(value, units.get(field))} {carries}"


def location(where: Mapping[str, Any] | None, units: Mapping[str, str]) -> list[str]:
    """Return in which equations, and where and when, the law acts."""
    if where is None:
        return []
    shares = sorted(where["equation"].items(), key=lambda item: -item[1])
    acting = [(field, share) for field, share in shares if share] or shares
    equations = f"the equation of {acting[0][0]}"
    if len(acting) > 1:
        listed = [f"{field} ({percent(share)})" for field, share in acting]
        equations = f"the equations of {joined(listed)}"
    return [f"It acts in {equations}, {extent(where, units)}."]


def extent(where: Mapping[str, Any], units: Mapping[str, str] = NO_UNITS) -> str:
    """Return ``for 10.1 < x < 16.0 (± 0.1)``, ``where u > 1.76 (…)``, or ``everywhere``."""
    if where["region"]:
        [region] = where["region"]
        return f"for {bounds(region, units)}"
    return f"where {where['regime']}" if where["regime"] else "everywhere"
