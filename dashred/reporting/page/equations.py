"""The corrected equations, with the added terms separate from the original ones."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import MINUS, number, parenthesize_sum, pretty, rounded
from dashred.core.units import NO_UNITS, with_unit
from dashred.reporting.text.fitted_parameters import fitted_parameter_text
from dashred.reporting.text.regions import bounds


def equations(findings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the equations and lets with their added terms, and the parameters with new values.

    Parameters that the law changes are apart from those that were fitted within their spreads.
    """
    system = findings["input"]["config"].get("system", {})
    terms, units = findings["terms"] or [], findings.get("units", NO_UNITS)

    def added(name: str) -> list[str]:
        return [_term(term, units) for term in terms if term["equation"] == name]

    rates = [
        {
            "field": field,
            "known": _format_expression(text),
            "added": added(field),
        }
        for field, text in system.get("equations", {}).items()
    ]
    if (hidden := findings.get("hidden_state")) is not None:
        rates.append({"field": hidden["state"], "known": "", "added": [_relaxation(hidden)]})
    return {
        "d": "∂" if system.get("axes") else "d",
        "rates": rates,
        "changed": [_parameter(term, units) for term in terms if term["equation"] is None],
        "fitted": [fitted_parameter_text(each) for each in findings.get("fitted_parameters", ())],
        "let": [
            {"name": name, "known": _format_expression(text), "added": added(name)}
            for name, text in system.get("let", {}).items()
        ],
    }


def _term(term: Mapping[str, Any], units: Mapping[str, str]) -> str:
    size, _ = rounded(abs(term["coefficient"]), term["std"])
    sign = MINUS if term["coefficient"] < 0 else "+"
    expression = parenthesize_sum(_format_expression(term["term"]))
    product = size if term["term"] == "1" else f"{size}·{expression}"
    where = f" for {bounds(term['region'][0], units)}" if term["region"] else ""
    return f"{sign} {product}{where}"


def _relaxation(hidden: Mapping[str, Any]) -> str:
    """Return the right-hand side of the equation of a hidden state."""
    tau, _ = rounded(hidden["time_constant"], hidden["time_constant_std"])
    return f"({hidden['follows']} {MINUS} {hidden['state']})/{tau}"


def _format_expression(text: str) -> str:
    return pretty(text).replace("-", MINUS)


def _parameter(term: Mapping[str, Any], units: Mapping[str, str]) -> dict[str, str]:
    new, _ = rounded(term["to"], term["std"])
    name = term["term"]
    return {"now": f"{name} = {with_unit(new, units.get(name))}", "was": number(term["from"])}
