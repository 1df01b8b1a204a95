"""Judge the findings of a case against its truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dashred.evaluation.foreign.cases.case import Kind, Truth
from dashred.evaluation.foreign.scoring.compare_law import covered, is_exact
from dashred.evaluation.foreign.scoring.outcomes import Outcome
from dashred.evaluation.twins.candidate_laws import MAX_LISTED, listed_laws
from dashred.physics.system import System

# Verdicts that say themselves that something is open.
FLAGGED = (
    "ambiguous",
    "outside-library",
    "not-converged",
    "unconfirmed",
    "unresolved-numerics",
    "mismatch",
)
LAWS = ("missing-term", "parameter")


@dataclass(frozen=True)
class Judgement:
    """The outcome of a case.

    Attributes:
        outcome: of the case.
        leading: whether the leading cause is the true one, also where the verdict is uncertain.
        located: whether the peak of a source is inside of it; None without a source.
        covered: whether the 95 % interval has the true value, for each told term of the true law.
    """

    outcome: Outcome
    leading: bool
    located: bool | None = None
    covered: list[bool] = field(default_factory=list)


@dataclass(frozen=True)
class Reading:
    """What findings say about a truth.

    Attributes:
        definite: the verdict is right, as it stands.
        leading: the leading cause is right.
        listed: the truth is among what is listed.
        located: as in :class:`Judgement`.
    """

    definite: bool
    leading: bool
    listed: bool
    located: bool | None = None


def judge(findings: Mapping[str, Any], truth: Truth, system: System) -> Judgement:
    """Return the outcome of findings, with the keys of this release."""
    verdict = findings["verdict"]
    if verdict is None:
        return Judgement("no-answer", leading=False)
    read = _READERS[truth.kind](findings, truth, system)
    outcome: Outcome = "silent-wrong"
    if read.definite:
        outcome = "right"
    elif verdict in FLAGGED:
        outcome = "listed" if read.listed else "flagged"
    terms = findings["terms"] or []
    intervals = covered(system, terms, truth) if read.leading else []
    return Judgement(outcome, read.definite or read.leading, read.located, intervals)


def _read_law(findings: Mapping[str, Any], truth: Truth, system: System) -> Reading:
    """A law is right if it is exact, or declared to read the same as one that is."""
    verdict = findings["verdict"]
    exact = is_exact(system, findings["terms"] or [], truth)
    same = [a["terms"] for a in findings["alternatives"] or [] if a["same_as_best"]]
    exact = exact or any(is_exact(system, _entries(law), truth) for law in same)
    beyond = (
        not truth.terms and verdict == "outside-library" and _in_equation(findings, truth, system)
    )
    listed = exact or any(is_exact(system, law, truth) for law in listed_laws(findings)[1:])
    return Reading((exact and verdict in LAWS) or beyond, exact, listed)


def _read_region(findings: Mapping[str, Any], truth: Truth, system: System) -> Reading:
    law = _read_law(findings, truth, system)
    return Reading(law.definite, law.leading, law.listed or _is_located(findings, truth, system))


def _read_source(findings: Mapping[str, Any], truth: Truth, system: System) -> Reading:
    """A source is right if it is located: as a source, as a term in a region or by the map."""
    located = _is_located(findings, truth, system)
    named = findings["verdict"] in ("outside-library", "missing-term")
    return Reading(located and named, located, located, located)


def _read_sensor(findings: Mapping[str, Any], truth: Truth, system: System) -> Reading:
    """A sensor is right if it is the only thing that is named; its curve may have any name."""
    named = [cause.get("sensor") for cause in findings["causes"] or []]
    first = bool(named) and named[0] == truth.sensor and not findings["terms"]
    return Reading(first and findings["verdict"] == "sensor-fault", first, truth.sensor in named)


def _read_nothing(findings: Mapping[str, Any], truth: Truth, system: System) -> Reading:
    kinds = [cause["kind"] for cause in findings["causes"] or []]
    right = findings["verdict"] == "nothing-missing"
    return Reading(right, kinds[:1] == ["nothing-missing"], "nothing-missing" in kinds[:MAX_LISTED])


_READERS: dict[Kind, Callable[[Mapping[str, Any], Truth, System], Reading]] = {
    "term": _read_law,
    "region": _read_region,
    "source": _read_source,
    "sensor": _read_sensor,
    "nothing": _read_nothing,
}


def _entries(law: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{**t, "region": [t["window"]] if t.get("window") else None} for t in law]


def _in_equation(findings: Mapping[str, Any], truth: Truth, system: System) -> bool:
    """Return whether the equation in which most is missing is one that lacks something."""
    where = (findings["where"] or {}).get("equation") or {}
    axes = (0, *range(2, truth.hidden.ndim))
    lacking = np.flatnonzero(np.abs(truth.hidden).max(axis=axes) > 0)
    return bool(where) and max(where, key=lambda name: where[name]) in [
        system.fields[i] for i in lacking
    ]


def _is_located(findings: Mapping[str, Any], truth: Truth, system: System) -> bool:
    """Return whether the told place is inside: of a region, of a source, or of the forcing's peak.

    The map of a forcing is coarser than a region or a source, and counts only without them.
    """
    assert truth.region is not None
    axis = system.axes[0]
    places = []
    for term in findings["terms"] or []:
        for region in term.get("region") or ():
            if region.get("axis") == axis.name and region.get("to") is not None:
                width = (region["to"] - region["from"]) % axis.length
                places.append(region["from"] + width / 2)
    where = findings["where"] or {}
    source, forcing = where.get("source"), where.get("forcing")
    if not places and source:
        places = [source["place"][0]]
    elif not places and forcing:
        places = [forcing["peak"][0]]
    width = (truth.region[1] - truth.region[0]) % axis.length
    return bool(places) and all((x - truth.region[0]) % axis.length <= width for x in places)
