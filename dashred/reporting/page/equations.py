"""The corrected equations, with what was put in apart from what was there."""

import re
from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import MINUS, number, pretty, rounded
from dashred.core.units import NO_UNITS, with_unit
from dashred.reporting.text.regions import bounds


def equations(findings: Mapping[str, Any]) -> dict[str, Any]:
    """The rate of each field with the terms added to it, and each parameter that changes."""
    system = findings["input"]["config"].get("system", {})
    terms, units = findings["terms"] or [], findings.get("units", NO_UNITS)
    rates = [
        {
            "field": field,
            "known": _printed(text),
            "added": [_term(term, units) for term in terms if term["equation"] == field],
        }
        for field, text in system.get("equations", {}).items()
    ]
    return {
        "d": "∂" if system.get("axes") else "d",
        "rates": rates,
        "changed": [_parameter(term, units) for term in terms if term["equation"] is None],
        "let": {name: _printed(text) for name, text in system.get("let", {}).items()},
    }


def _term(term: Mapping[str, Any], units: Mapping[str, str]) -> str:
    size, _ = rounded(abs(term["coefficient"]), term["std"])
    sign = MINUS if term["coefficient"] < 0 else "+"
    product = size if term["term"] == "1" else f"{size}·{_factor(_printed(term['term']))}"
    where = f" for {bounds(term['region'][0], units)}" if term["region"] else ""
    return f"{sign} {product}{where}"


def _printed(text: str) -> str:
    return pretty(text).replace("-", MINUS)


def _factor(text: str) -> str:
    """A sum in parentheses, so that the coefficient is seen to multiply all of it."""
    flat = text
    while (rest := re.sub(r"\([^()]*\)", "", flat)) != flat:
        flat = rest
    return f"({text})" if re.search(rf" [+{MINUS}] ", flat) else text


def _parameter(term: Mapping[str, Any], units: Mapping[str, str]) -> dict[str, str]:
    new, _ = rounded(term["to"], term["std"])
    name = term["term"]
    return {"now": f"{name} = {with_unit(new, units.get(name))}", "was": number(term["from"])}
