"""Read the findings of stored rows and cases, which may come from an earlier release.

Earlier findings use deprecated names of methods, and give the window of an alternative as text.
Both are translated here only.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from dashred.core.findings.law_schema import Region
from dashred.core.findings.methods import current_names

HELD_OUT = ("test_sensors", "heldout_time", "heldout_restarted", "heldout_episode")
NUMBER = r"[-+]?[0-9.]+(?:e[-+]?[0-9]+)?"
TEXT = re.compile(rf"for (?:({NUMBER}) < )?(\w+) ([<>]) ({NUMBER})(?: .*)?\Z")


def read_findings(folder: Path) -> dict[str, Any]:
    """Return ``findings.json`` of a folder with the keys of this release."""
    findings: dict[str, Any] = json.loads((folder / "findings.json").read_text(encoding="utf-8"))
    fit = findings.get("fit") or {}
    for part in HELD_OUT:
        if fit.get(part):
            fit[part] = current_names(fit[part])
    for law in (*(findings.get("alternatives") or []), *(findings.get("smaller") or [])):
        for term in law["terms"]:
            if "window" not in term:
                term["window"] = region_of_text(term["region"])
    return findings


def region_of_text(text: str | None) -> Region | None:
    """Return the region that earlier findings hold as text: ``for 1.5 < x < 2.5 m``."""
    if text is None:
        return None
    match = TEXT.match(text)
    if match is None:
        raise ValueError(f"this is not the region of a term: {text}")
    begin, of, sign, edge = match.groups()
    if begin is not None:
        return {"axis": of, "from": float(begin), "to": float(edge)}
    if of == "t":
        return {"axis": of, "from": float(edge)}
    return (
        {"field": of, "above": float(edge)} if sign == ">" else {"field": of, "below": float(edge)}
    )
