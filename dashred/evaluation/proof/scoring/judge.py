"""Judge one case: frozen findings against what was hidden, as the record ``case.json`` has it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dashred.core.findings.findings import canonical
from dashred.core.findings.schema import Score
from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.cases.descriptions import hidden_in_words, told_in_words
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.effect_size import Concealed
from dashred.evaluation.proof.cases.nearness import (
    coefficients_found,
    gains,
    noisy_test,
    peak_inside,
    region_off,
)
from dashred.evaluation.proof.cases.oracle import consult
from dashred.evaluation.twins.candidate_laws import LISTED, listed_laws
from dashred.evaluation.twins.cause_scoring import score_cause
from dashred.evaluation.twins.kept_findings import read_findings
from dashred.evaluation.twins.scoring import law_of_findings, law_of_truth, score_law

# Verdicts that themselves say that they may be wrong.
FLAGGED = ("ambiguous", "not-converged")
LAWS = ("terms", "hidden", "box", "gate", "onset")


def judge(
    case: Case,
    concealed: Concealed,
    folder: Path,
    score: Score,
    seconds: float | None,
) -> CaseRecord:
    """Return the record of a case whose findings are frozen and whose seal is open."""
    findings = read_findings(folder)
    verdict = findings["verdict"]
    right = is_right(case, findings, concealed)
    exact = score["exact_support"]
    if exact is False and _is_alias(findings, concealed):
        exact = True
    oracle = consult(case, concealed, folder, exact=exact is True)
    causes = findings["causes"] or []
    record = unjudged(case, concealed) | {
        "told": told_in_words(findings),
        "verdict": verdict,
        "probability": causes[0]["probability"] if causes else None,
        "causes": [cause["kind"] for cause in causes],
        "right": right,
        "listed": right or (verdict == "ambiguous" and is_listed(case, findings, concealed)),
        "exact": exact,
        "flagged": verdict in FLAGGED,
        "equation_right": _equation_right(case, findings, concealed),
        "region": region_off(score, findings, concealed),
        "peak_inside": peak_inside(case, findings, concealed),
        "coefficients": coefficients_found(findings, concealed) if score["exact_support"] else [],
        "oracle": oracle,
        "gains": gains(case, findings, concealed, folder, score),
        "noisy_test": noisy_test(findings),
        "seconds": seconds,
    }
    found: CaseRecord = canonical(record)
    return found


def unjudged(case: Case, concealed: Concealed | None, problem: str | None = None) -> CaseRecord:
    """Return the record of a case of which there are no findings yet.

    What it hides is not told, unless its seal is open: one that died is analysed again.
    """
    hidden = "not opened"
    if concealed is not None:
        hidden = hidden_in_words(case, concealed.truth, concealed.config)
    return {
        "number": case.number,
        "system": case.system,
        "group": "cases" if case.group == "cases" else "nulls",
        "kind": case.kind,
        "noise": case.noise,
        "sensors": case.sensors,
        "hidden": hidden,
        "told": "nothing",
        "mismatch": None if concealed is None else concealed.effect,
        "verdict": None,
        "probability": None,
        "causes": [],
        "right": False,
        "listed": False,
        "exact": None,
        "flagged": False,
        "problem": problem,
        "equation_right": None,
        "region": None,
        "peak_inside": None,
        "coefficients": [],
        "oracle": None,
        "gains": None,
        "noisy_test": None,
        "seconds": None,
    }


def is_right(case: Case, findings: Mapping[str, Any], concealed: Concealed) -> bool:
    """Return whether the verdict, and what it names, is right: of a law, its exact form."""
    verdict, truth = findings["verdict"], concealed.truth
    hidden = truth.concealed
    if accuses_wrongly(findings, concealed):
        return False
    if case.kind == "null":
        # A sensor that stands a little off its place may be named, if it is that one.
        named = hidden.faults and score_cause(findings, False, hidden)
        return bool(verdict == "nothing-missing" or named)
    if case.kind == "numerics":
        return bool(verdict == "unresolved-numerics")
    exact, _ = score_law(findings, truth.terms, hidden.parameters)
    if case.kind == "outside":
        return bool(verdict == "outside-library" or (exact and verdict == "missing-term"))
    if case.kind in LAWS or case.kind == "parameter":
        named = exact or _is_alias(findings, concealed)
        return bool(named and verdict in ("missing-term", "parameter"))
    right = bool(score_cause(findings, bool(truth.terms), hidden))
    if case.kind == "masked":
        # Each cause that is named has to be a true one; not all need to be seen.
        found = law_of_findings(findings)
        return (
            right and found.keys() <= law_of_truth(findings, truth.terms, hidden.parameters).keys()
        )
    return right


def accuses_wrongly(findings: Mapping[str, Any], concealed: Concealed) -> bool:
    """Return whether a sensor without the fault that is told stands beside the best law."""
    causes = list(findings["causes"] or [])
    if findings["verdict"] == "outside-library" and "terms" not in causes[0]:
        # That no law explains stands before the best of them.
        causes = causes[1:]
    if len(causes) < 2:
        return False
    law, told = causes[:2]
    # The cause of a law and the fault beside it are one explanation, of one probability.
    if told["kind"] != "sensor-fault" or told["probability"] != law["probability"]:
        return False
    hidden = {(fault.sensor, fault.kind) for fault in concealed.truth.concealed.faults}
    return (told["sensor"], told["fault"]) not in hidden


def _is_alias(findings: Mapping[str, Any], concealed: Concealed) -> bool:
    """Return whether a parameter was named that does the same as the true one, and says so."""
    true = concealed.truth.concealed.parameters
    if len(findings["terms"] or []) != 1 or len(true) != 1 or concealed.truth.terms:
        return False
    [entry], [name] = findings["terms"], true
    return name in entry.get("aliases", ())


def is_listed(case: Case, findings: Mapping[str, Any], concealed: Concealed) -> bool:
    """Return whether the truth is among the explanations that ambiguous findings list."""
    truth = concealed.truth
    parameters = truth.concealed.parameters
    if truth.terms or parameters:
        best, *rivals = listed_laws(findings)
        laws = rivals if accuses_wrongly(findings, concealed) else [best, *rivals]
        return any(
            score_law({**findings, "terms": law}, truth.terms, parameters)[0] for law in laws
        )
    for cause in findings["causes"][:LISTED]:
        alone = {**findings, "verdict": cause["kind"], "causes": [cause]}
        if cause["kind"] in ("missing-term", "parameter"):
            continue
        if cause["kind"] == "nothing-missing":
            if case.kind == "null":
                return True
            continue
        if score_cause(alone, False, truth.concealed):
            return True
    return False


def _equation_right(case: Case, findings: Mapping[str, Any], concealed: Concealed) -> bool | None:
    """Return whether the law of a hidden field stands in its equation, or in one just like it."""
    if case.kind != "hidden" or findings["terms"] is None:
        return None
    true = {term.equation for term in concealed.truth.terms}
    same = [a["terms"] for a in findings["alternatives"] if a["same_as_best"]]
    laws = [findings["terms"], *same]
    return any({term["equation"] for term in law} == true for law in laws)
