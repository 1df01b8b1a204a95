"""The laws that findings list when they are ambiguous: the best guess, and its rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

# So many explanations may be listed for the truth to count as listed.
LISTED = 3


def listed_laws(findings: Mapping[str, Any]) -> list[list[dict[str, Any]]]:
    """Return the first three laws, each as findings hold the best one's terms."""
    rivals = [a["terms"] for a in findings["alternatives"] or [] if a["rival"]][: LISTED - 1]
    known = findings["input"]["config"]["system"]["parameters"]
    return [list(findings["terms"] or []), *(_as_found(rival, known) for rival in rivals)]


def _as_found(
    terms: Sequence[Mapping[str, Any]], parameters: Mapping[str, float]
) -> list[dict[str, Any]]:
    """Return an alternative's terms in the form of the best law's.

    Args:
        terms: as alternatives have them.
        parameters: values that the simulator has.
    """
    found = []
    for term in terms:
        entry = {**term, "region": [term["window"]] if term["window"] else None}
        if term["equation"] is None:
            name = term["term"]
            entry |= {"parameter": name, "to": parameters[name] + term["coefficient"]}
        found.append(entry)
    return found
