"""Record a case, and draw another in its place where nobody could tell what it hides.

Of the laws that act everywhere many can be told from no other by these sensors. Most of those are
drawn again: by what is foreseen from the truth alone, before any analysis has begun. So is what the
simulator's numerics do not resolve to its noise, but for the cases that hide just that.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.data.io.write_netcdf import write_netcdf
from dashred.evaluation.proof.cases.draw import Case, draw_again
from dashred.evaluation.proof.cases.effect_size import Concealed, conceal
from dashred.evaluation.proof.cases.identifiability import CLEAR, FORESEEN, lead
from dashred.evaluation.proof.cases.oracle import DECIDABLE

# Share of the unclear cases that stay as they are, and how often another is drawn at most.
STAYING = 0.25
MOST_DRAWS = 12


@dataclass(frozen=True)
class RecordedCase:
    """A case as it was drawn in the end.

    Attributes:
        case: what was drawn.
        draws: how often, 1 for most.
        concealed: the truth.
    """

    case: Case
    draws: int
    concealed: Concealed


def record_case(case: Case, recording: Path) -> RecordedCase:
    """Record a case, or another of its kind in its place, as the NetCDF `recording`.

    Raises:
        InputError: the truth blows up, however small.
    """
    for draws in range(1, MOST_DRAWS + 1):
        concealed = conceal(case)
        axes = [axis.name for axis in concealed.system.axes]
        write_netcdf(concealed.recording, recording, axes)
        if draws == MOST_DRAWS or _stays(case, concealed, recording):
            break
        case = draw_again(case, draws)
    return RecordedCase(case, draws, concealed)


def _stays(case: Case, concealed: Concealed, recording: Path) -> bool:
    if case.kind != "numerics" and not concealed.numerics < DECIDABLE:
        return False
    if case.kind not in FORESEEN or case.stream("stays").random() < STAYING:
        return True
    return lead(case, concealed, recording) > CLEAR
