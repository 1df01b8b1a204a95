"""A localised source, as text."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import Z95, percent, rounded, with_error
from dashred.core.units import NO_UNITS, TIME, with_unit


def source_text(source: Mapping[str, Any], units: Mapping[str, str] = NO_UNITS) -> str:
    """Return a source in two sentences: where and when it acts, and how strong it is."""
    text = f"a {_kind(source)} in the equation of {source['equation']} {_place(source, units)}, "
    text += f"{_region(source, units)}{_course(source, units)}"
    strength = with_error(abs(source["strength"]), source["strength_std"])
    return (
        f"{text}. Its mean strength, integrated over space, is {strength}; it explains "
        f"{percent(source['share'])} of the misfit beyond noise"
    )


def short_source_text(source: Mapping[str, Any], units: Mapping[str, str] = NO_UNITS) -> str:
    """Return a source without errors: ``a source in the equation of c about x = 8.3``."""
    places = " and ".join(
        f"{each['axis']} = {with_unit(f'{place:.3g}', units.get(each['axis']))}"
        for each, place in zip(source["region"], source["place"], strict=True)
    )
    text = f"a {_kind(source)} in the equation of {source['equation']} about {places}"
    if source["period"] is None:
        return text
    period = with_unit(f"{source['period']:.3g}", units.get(TIME))
    return f"{text} that pulsates with a period of {period}"


def _kind(source: Mapping[str, Any]) -> str:
    return "source" if source["strength"] >= 0 else "sink"


def _place(source: Mapping[str, Any], units: Mapping[str, str]) -> str:
    places = []
    for region, place, std in zip(
        source["region"], source["place"], source["place_std"], strict=True
    ):
        axis = region["axis"]
        places.append(f"{axis} = {with_unit(with_error(place, std), units.get(axis))}")
    return f"about {' and '.join(places)}"


def _region(source: Mapping[str, Any], units: Mapping[str, str]) -> str:
    parts = []
    for region, std in zip(source["region"], source["place_std"], strict=True):
        axis = region["axis"]
        begin, _ = rounded(region["from"], Z95 * std)
        end, _ = rounded(region["to"], Z95 * std)
        text = f"between {axis} = {begin} and {with_unit(end, units.get(axis))}"
        around = " across the ends of the axis" if region["from"] > region["to"] else ""
        parts.append(text + around)
    return " and ".join(parts)


def _course(source: Mapping[str, Any], units: Mapping[str, str]) -> str:
    if source["period"] is not None:
        period = with_error(source["period"], source["period_std"])
        return f", that pulsates with a period of {with_unit(period, units.get(TIME))}"
    if source["begin"] is not None:
        begin = with_error(source["begin"], source["begin_std"])
        return f", that begins at time {with_unit(begin, units.get(TIME))}"
    return ""
