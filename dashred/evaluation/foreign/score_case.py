"""Score a case: its frozen findings against its truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dashred.core.findings.findings import check_freeze
from dashred.evaluation.foreign.cases.case import Case, Truth
from dashred.evaluation.foreign.cases.case_files import read_simulator
from dashred.evaluation.foreign.rows import Row
from dashred.evaluation.foreign.scoring.judge import judge
from dashred.evaluation.proof.cases.descriptions import describe_findings
from dashred.evaluation.twins.findings_reader import read_findings

# The gain if the simulation diverges and the model does not.
LARGEST_GAIN = 1e6


def score_case(case: Case, truth: Truth, given: Path, folder: Path) -> Row:
    """Return the row of a case with findings, without its times and its peers.

    The simulator is that of the case: in the findings the fields are in another order.

    Args:
        case: the case.
        truth: what was hidden.
        given: folder of the files of the case.
        folder: folder of the findings.

    Raises:
        InputError: the findings have changed since they were frozen.
    """
    check_freeze(folder)
    findings = read_findings(folder)
    judged = judge(findings, truth, read_simulator(given))
    causes = findings["causes"] or []
    answer: Row = {
        **empty_row(case, truth),
        "verdict": findings["verdict"],
        "told": describe_findings(findings),
        "outcome": judged.outcome,
        "leading_right": judged.leading,
        "probability": causes[0]["probability"] if causes else None,
        "located": judged.located,
        "covered": judged.covered,
        "gain_sensors": gain(findings["fit"]["test_sensors"]),
        "gain_time": gain(findings["fit"]["heldout_time"]),
        "gain_forecast": gain(findings["fit"].get("heldout_restarted") or {}),
    }
    return answer


def empty_row(case: Case, truth: Truth | None, problem: str | None = None) -> Row:
    """Return the row of a case without an answer."""
    return Row(
        case=case.name,
        collection=case.collection,
        system=case.system,
        kind=case.kind,
        number=case.number,
        noise=case.noise,
        seed=case.seed,
        hidden="not made" if truth is None else truth.says,
        verdict=None,
        told="nothing",
        outcome="no-answer",
        leading_right=False,
        probability=None,
        located=None,
        covered=[],
        gain_sensors=None,
        gain_time=None,
        gain_forecast=None,
        seconds=None,
        wall=0.0,
        problem=problem,
        peers={},
    )


def gain(errors: Mapping[str, Any]) -> float | None:
    """Return the error of the simulation over that of the model; None without the latter.

    The error of a run that diverges is stored as none. Beside one of the model that does not, it
    counts as the largest gain.
    """
    before, after = errors.get("simulation_refit"), errors.get("corrected")
    if not after:
        return None
    return LARGEST_GAIN if before is None else min(before / after, LARGEST_GAIN)
