"""The corrected equations in HTML, with what was put in highlighted."""

import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from dashred.core.formatting import MINUS, number, pretty, rounded
from dashred.core.units import NONE, measured
from dashred.reporting.text.verdict import bounds


def equations_html(findings: Mapping[str, Any]) -> str:
    """One line for each equation, and one for each parameter that changes; empty without any."""
    system = findings["input"]["config"].get("system", {})
    equations: Mapping[str, str] = system.get("equations", {})
    terms, units = findings["terms"] or [], findings.get("units", NONE)
    if not equations:
        return ""
    partial = bool(system.get("axes"))
    lines = [
        _equation(field, text, [t for t in terms if t["equation"] == field], units, partial)
        for field, text in equations.items()
    ]
    lines += [_parameter(term, units) for term in terms if term["equation"] is None]
    lets = [f"{name} = {_printed(text)}" for name, text in system.get("let", {}).items()]
    told = "".join(f'<div class="eq">{line}</div>' for line in lines)
    where = "".join(f'<div class="eq let">with {escape(line)}</div>' for line in lets)
    return f'<div class="equations">{told}{where}</div>'


def _equation(
    field: str,
    text: str,
    added: Sequence[Mapping[str, Any]],
    units: Mapping[str, str],
    partial: bool,
) -> str:
    d = "∂" if partial else "d"
    gap = "" if len(field) == 1 else "&thinsp;"
    terms = "".join(f" <mark>{_term(term, units)}</mark>" for term in added)
    return f"{d}{gap}{escape(field)}/{d}t = {escape(_printed(text))}{terms}"


def _term(term: Mapping[str, Any], units: Mapping[str, str]) -> str:
    size, _ = rounded(abs(term["coefficient"]), term["std"])
    sign = MINUS if term["coefficient"] < 0 else "+"
    product = size if term["term"] == "1" else f"{size}·{_factor(_printed(term['term']))}"
    where = f" for {bounds(term['region'][0], units)}" if term["region"] else ""
    return escape(f"{sign} {product}{where}")


def _printed(text: str) -> str:
    return pretty(text).replace("-", MINUS)


def _factor(text: str) -> str:
    """A sum in parentheses, so that the coefficient is seen to multiply all of it."""
    flat = text
    while (rest := re.sub(r"\([^()]*\)", "", flat)) != flat:
        flat = rest
    return f"({text})" if re.search(rf" [+{MINUS}] ", flat) else text


def _parameter(term: Mapping[str, Any], units: Mapping[str, str]) -> str:
    new, _ = rounded(term["to"], term["std"])
    name, unit = term["term"], units.get(term["term"])
    told = f"{name} = {measured(new, unit)}"
    return f"<mark>{escape(told)}</mark> instead of {escape(number(term['from']))}"
