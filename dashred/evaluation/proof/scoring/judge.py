"""Score one case: compare frozen findings with its truth and build its record."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dashred.core.findings.findings import canonical
from dashred.core.findings.schema import Score
from dashred.evaluation.proof.cases.accuracy import (
    coefficients_found,
    gains,
    noisy_test_change,
    peak_inside,
    region_errors,
)
from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.cases.descriptions import describe_findings, describe_hidden
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.effect_size import CaseTruth
from dashred.evaluation.proof.cases.oracle import compute_oracle
from dashred.evaluation.twins.candidate_laws import MAX_LISTED, listed_laws
from dashred.evaluation.twins.cause_scoring import score_cause
from dashred.evaluation.twins.findings_reader import read_findings
from dashred.evaluation.twins.scoring import law_of_findings, law_of_truth, score_law

# Verdicts that state their own uncertainty.
FLAGGED = ("ambiguous", "not-converged", "unconfirmed")
# Of these, the explanations are listed.
LISTING = ("ambiguous", "unconfirmed")
LAWS = ("terms", "hidden", "box", "gate", "onset")


def judge(
    case: Case,
    case_truth: CaseTruth,
    folder: Path,
    score: Score,
    seconds: float | None,
) -> CaseRecord:
    """Return the record of a case with frozen findings and an open seal."""
    findings = read_findings(folder)
    verdict = findings["verdict"]
    right = is_right(case, findings, case_truth)
    exact = score["exact_support"]
    if exact is False and _is_alias(findings, case_truth):
        exact = True
    oracle = compute_oracle(case, case_truth, folder, exact=exact is True)
    causes = findings["causes"] or []
    record = empty_record(case, case_truth) | {
        "told": describe_findings(findings),
        "verdict": verdict,
        "probability": causes[0]["probability"] if causes else None,
        "causes": [cause["kind"] for cause in causes],
        "right": right,
        "listed": right or (verdict in LISTING and is_listed(case, findings, case_truth)),
        "exact": exact,
        "flagged": verdict in FLAGGED,
        "equation_right": _equation_right(case, findings, case_truth),
        "region": region_errors(score, findings, case_truth),
        "peak_inside": peak_inside(case, findings, case_truth),
        "coefficients": coefficients_found(findings, case_truth) if score["exact_support"] else [],
        "oracle": oracle,
        "gains": gains(case, findings, case_truth, folder, score),
        "noisy_test": noisy_test_change(findings),
        "seconds": seconds,
    }
    canonical_record: CaseRecord = canonical(record)
    return canonical_record


def empty_record(
    case: Case, case_truth: CaseTruth | None, problem: str | None = None
) -> CaseRecord:
    """Return the record of a case without findings.

    A failed case is analysed again, so its record describes the hidden effect only if its seal is
    open.
    """
    hidden = "not opened"
    if case_truth is not None:
        hidden = describe_hidden(case, case_truth.truth, case_truth.config)
    return {
        "number": case.number,
        "system": case.system,
        "group": "cases" if case.group == "cases" else "nulls",
        "kind": case.kind,
        "noise": case.noise,
        "sensors": case.sensors,
        "hidden": hidden,
        "told": "nothing",
        "mismatch": None if case_truth is None else case_truth.effect,
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


def is_right(case: Case, findings: Mapping[str, Any], case_truth: CaseTruth) -> bool:
    """Return whether the verdict and the cause that it names are right; a law must be exact."""
    verdict, truth = findings["verdict"], case_truth.truth
    hidden = truth.concealed
    if names_wrong_fault(findings, case_truth):
        return False
    if case.kind == "null":
        # Naming the sensor that is slightly misplaced is right.
        named = hidden.faults and score_cause(findings, False, hidden)
        return bool(verdict == "nothing-missing" or named)
    if case.kind == "numerics":
        return bool(verdict == "unresolved-numerics")
    exact, _ = score_law(findings, truth.terms, hidden.parameters)
    if case.kind == "outside":
        return bool(verdict == "outside-library" or (exact and verdict == "missing-term"))
    if case.kind in LAWS or case.kind == "parameter":
        named = exact or _is_alias(findings, case_truth)
        return bool(named and verdict in ("missing-term", "parameter"))
    right = bool(score_cause(findings, bool(truth.terms), hidden))
    if case.kind == "masked":
        # Each named cause has to be true, but not all have to be named.
        found = law_of_findings(findings)
        return (
            right and found.keys() <= law_of_truth(findings, truth.terms, hidden.parameters).keys()
        )
    return right


def names_wrong_fault(findings: Mapping[str, Any], case_truth: CaseTruth) -> bool:
    """Return whether the best explanation names a law and a sensor fault that does not exist."""
    causes = list(findings["causes"] or [])
    if findings["verdict"] == "outside-library" and "terms" not in causes[0]:
        # The first cause states that no law explains the data; the best law comes second.
        causes = causes[1:]
    if len(causes) < 2:
        return False
    law, fault = causes[:2]
    # A law and a fault that form one explanation have the same probability.
    if fault["kind"] != "sensor-fault" or fault["probability"] != law["probability"]:
        return False
    hidden = {(true.sensor, true.kind) for true in case_truth.truth.concealed.faults}
    return (fault["sensor"], fault["fault"]) not in hidden


def _is_alias(findings: Mapping[str, Any], case_truth: CaseTruth) -> bool:
    """Return whether a parameter was named that is declared equivalent to the true one."""
    true = case_truth.truth.concealed.parameters
    if len(findings["terms"] or []) != 1 or len(true) != 1 or case_truth.truth.terms:
        return False
    [entry], [name] = findings["terms"], true
    return name in entry.get("aliases", ())


def is_listed(case: Case, findings: Mapping[str, Any], case_truth: CaseTruth) -> bool:
    """Return whether findings list the truth among their first explanations."""
    truth = case_truth.truth
    parameters = truth.concealed.parameters
    if truth.terms or parameters:
        best, *rivals = listed_laws(findings)
        laws = rivals if names_wrong_fault(findings, case_truth) else [best, *rivals]
        return any(
            score_law({**findings, "terms": law}, truth.terms, parameters)[0] for law in laws
        )
    for cause in findings["causes"][:MAX_LISTED]:
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


def _equation_right(case: Case, findings: Mapping[str, Any], case_truth: CaseTruth) -> bool | None:
    """Return whether the law of a hidden field was found in its equation or an equivalent one."""
    if case.kind != "hidden" or findings["terms"] is None:
        return None
    true = {term.equation for term in case_truth.truth.terms}
    same = [a["terms"] for a in findings["alternatives"] if a["same_as_best"]]
    laws = [findings["terms"], *same]
    return any({term["equation"] for term in law} == true for law in laws)
