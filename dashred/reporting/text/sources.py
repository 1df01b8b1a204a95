"""A localised source, as text."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import Z95, percent, rounded, sentence, with_error
from dashred.core.units import NO_UNITS, TIME, with_unit
from dashred.reporting.text.causes import reported_causes


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
    """Return a source without errors: ``a source in the equation of c near x = 8.3``."""
    places = " and ".join(
        f"{each['axis']} = {with_unit(f'{place:.3g}', units.get(each['axis']))}"
        for each, place in zip(source["region"], source["place"], strict=True)
    )
    text = f"a {_kind(source)} in the equation of {source['equation']} near {places}"
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
    return f"at {' and '.join(places)}"


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
        return f"; it pulsates with a period of {with_unit(period, units.get(TIME))}"
    if source["begin"] is not None:
        begin = with_error(source["begin"], source["begin_std"])
        return f"; it begins at time {with_unit(begin, units.get(TIME))}"
    return ""


def located_source(findings: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the localised source of the findings, if there is one."""
    found: Mapping[str, Any] | None = (findings["where"] or {}).get("source")
    return found


def source(findings: Mapping[str, Any]) -> list[str]:
    """Return the localised source, or where the force is largest that no law explains."""
    units = findings.get("units", NO_UNITS)
    if found := located_source(findings):
        return [sentence(source_text(found, units))]
    forcing = (findings["where"] or {}).get("forcing")
    is_unexplained = any("gain" in cause for cause in reported_causes(findings))
    if forcing is None or not is_unexplained:
        return []
    if not forcing["peak"]:
        return _force_in_time(forcing)
    peak = " and ".join(
        f"{axis} = {with_unit(f'{place:.3g}', units.get(axis))}"
        for axis, place in zip(_axes(findings), forcing["peak"], strict=True)
    )
    return [f"The force that the simulation lacks is largest near {peak}."]


def _force_in_time(forcing: Mapping[str, Any]) -> list[str]:
    """Return in which equations a force of a system without axes acts, and when most."""
    size = {
        field: [abs(value) for value in cells[0]] for field, cells in forcing["amplitude"].items()
    }
    acting = [field for field, values in size.items() if any(values)]
    if not acting:
        return []
    largest = max(acting, key=lambda field: max(size[field]))
    when = forcing["times"][size[largest].index(max(size[largest]))]
    equations = "equation" if len(acting) == 1 else "equations"
    return [
        f"The force that the simulation lacks acts in the {equations} of {' and '.join(acting)}, "
        f"and is largest near t = {when:.4g}."
    ]


def _axes(findings: Mapping[str, Any]) -> list[str]:
    return list(findings["input"]["config"]["system"]["axes"])
