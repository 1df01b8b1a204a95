"""One-line descriptions of the hidden effect and of the findings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from dashred.config import Config
from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.twins.sealing import Truth

SEPARATOR = "; "


def describe_hidden(case: Case, truth: Truth, config: Config) -> str:
    """Describe the hidden effect of a case."""
    hidden, known = truth.concealed, config.system.parameters
    parts = [f"{t.equation}: {t.coefficient:+.3g}·{t.term}{_window(t.window)}" for t in truth.terms]
    parts += [f"{n} is {value:g}, not {known[n]:g}" for n, value in hidden.parameters.items()]
    parts += [f"{fault.kind} of {fault.sensor} ({fault.value:g})" for fault in hidden.faults]
    if hidden.spread > 1:
        parts.append(f"start off by {hidden.spread:g} times its spread")
    if hidden.correlation:
        parts.append(f"noise correlated by {hidden.correlation:g}")
    if "stated" in case.hidden:
        parts.append(f"noise stated {case.hidden['stated']:g} times its size")
    if case.words:
        parts.append(f"a simulator that is too coarse ({', '.join(case.words)})")
    return SEPARATOR.join(parts) or "nothing"


def describe_outcome(record: CaseRecord) -> str:
    """Describe the outcome of a case."""
    how = "right" if record["right"] else "listed" if record["listed"] else "NOT RIGHT"
    return f"{how}; hidden: {record['hidden']}; found: {record['problem'] or record['told']}"


def describe_findings(findings: Mapping[str, Any]) -> str:
    """Describe the verdict and its best explanation."""
    verdict = findings["verdict"]
    if verdict is None:
        return "nothing"
    parts = [_term(entry) for entry in findings["terms"] or []]
    causes = findings["causes"] or []
    if causes and not parts and "says" in causes[0]:
        parts.append(str(causes[0]["says"]))
    if verdict == "ambiguous":
        parts.append("or " + ", or ".join(_alternatives(findings)))
    return f"{verdict}: {SEPARATOR.join(parts)}" if parts else str(verdict)


def _alternatives(findings: Mapping[str, Any]) -> Iterable[str]:
    laws = [a["terms"] for a in findings["alternatives"] if a["rival"]]
    for terms in laws[:3]:
        yield (
            " + ".join(
                f"{t['equation'] or 'parameter'}: {t['coefficient']:+.3g}·{t['term']}"
                f"{' ' + t['region'] if t['region'] else ''}"
                for t in terms
            )
            or "another cause"
        )


def _term(entry: Mapping[str, Any]) -> str:
    if entry["equation"] is None:
        return f"{entry['parameter']} is {entry['to']:.4g}, not {entry['from']:.4g}"
    where = ""
    if entry.get("region"):
        [region] = entry["region"]
        if "axis" in region:
            upto = f" to {region['to']:.3g}" if region.get("to") is not None else " on"
            where = f" in {region['axis']} from {region['from']:.3g}{upto}"
        else:
            side = "above" if "above" in region else "below"
            where = f" where {region['field']} is {side} {region[side]:.3g}"
    return f"{entry['equation']}: {entry['coefficient']:+.3g}·{entry['term']}{where}"


def _window(window: tuple[str, float | None, float | None, float] | None) -> str:
    if window is None:
        return ""
    of, begin, end, _ = window
    if begin is None:
        return f" for {of} < {end:g}"
    return f" for {of} > {begin:g}" if end is None else f" for {begin:g} < {of} < {end:g}"
