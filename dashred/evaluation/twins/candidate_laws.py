"""Candidate laws of ambiguous findings: the best law and its rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

# Number of explanations among which the truth counts as listed.
MAX_LISTED = 3


def listed_laws(findings: Mapping[str, Any]) -> list[list[dict[str, Any]]]:
    """Return up to three laws, each in the form in which findings hold the terms of the best."""
    rivals = [a["terms"] for a in findings["alternatives"] or [] if a["rival"]][: MAX_LISTED - 1]
    known = findings["input"]["config"]["system"]["parameters"]
    return [list(findings["terms"] or []), *(_in_findings_form(rival, known) for rival in rivals)]


def _in_findings_form(
    terms: Sequence[Mapping[str, Any]], parameters: Mapping[str, float]
) -> list[dict[str, Any]]:
    """Return the terms of an alternative in the form of the best law.

    Args:
        terms: terms of an alternative.
        parameters: values of the simulator's parameters.
    """
    entries = []
    for term in terms:
        entry = {**term, "region": [term["window"]] if term["window"] else None}
        if term["equation"] is None:
            name = term["term"]
            entry |= {"parameter": name, "to": parameters[name] + term["coefficient"]}
        entries.append(entry)
    return entries
