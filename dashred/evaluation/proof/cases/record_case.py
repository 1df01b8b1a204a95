"""Record a case, or redraw it if its hidden effect cannot be identified.

Many laws that act everywhere cannot be separated from others by the sensors. Most of them are drawn
again, based on the truth alone and before any analysis. Cases whose numerical error is not small
compared with the noise are also drawn again, unless unresolved numerics are their hidden effect.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.data.io.write_netcdf import write_netcdf
from dashred.evaluation.proof.cases.draw import Case, redraw
from dashred.evaluation.proof.cases.effect_size import CaseTruth, record_truth
from dashred.evaluation.proof.cases.identifiability import (
    CLEAR_MARGIN,
    ENUMERABLE_KINDS,
    score_margin,
)
from dashred.evaluation.proof.cases.oracle import DECIDABLE

# Share of the unclear cases that are kept, and the largest number of draws.
KEPT_SHARE = 0.25
MAX_DRAWS = 12


@dataclass(frozen=True)
class RecordedCase:
    """A case as it was finally drawn.

    Attributes:
        case: the case.
        draws: number of draws, usually 1.
        case_truth: its truth.
    """

    case: Case
    draws: int
    case_truth: CaseTruth


def record_case(case: Case, recording: Path) -> RecordedCase:
    """Record a case, or another of its kind, as the NetCDF file `recording`.

    Raises:
        InputError: the truth blows up at every size.
    """
    for draws in range(1, MAX_DRAWS + 1):
        case_truth = record_truth(case)
        axes = [axis.name for axis in case_truth.system.axes]
        write_netcdf(case_truth.recording, recording, axes)
        if draws == MAX_DRAWS or _is_accepted(case, case_truth, recording):
            break
        case = redraw(case, draws)
    return RecordedCase(case, draws, case_truth)


def _is_accepted(case: Case, case_truth: CaseTruth, recording: Path) -> bool:
    if case.kind != "numerics" and not case_truth.numerics < DECIDABLE:
        return False
    if case.kind not in ENUMERABLE_KINDS or case.stream("stays").random() < KEPT_SHARE:
        return True
    return score_margin(case, case_truth, recording) > CLEAR_MARGIN
