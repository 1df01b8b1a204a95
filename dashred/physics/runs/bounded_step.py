"""The time step at which a corrected simulator stays bounded, and where its law diverges.

The time step was chosen for the simulator without the law. A law may make it stiff: the step is
then too long for an explicit method. Or the law itself diverges where the recording has no data.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.physics.runs.resolution import UNSTABLE
from dashred.physics.runs.step_stability import STEPS, Along, is_stable
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

# The step is halved so many times at most.
MAX_HALVINGS = 4
# A run that diverges at the same sample with half of the step, after so many samples, does not
# diverge by its steps.
FEWEST_SAMPLES = 5


@dataclass(frozen=True)
class BoundedStep:
    """How the corrected simulator runs over the recording and its forecast.

    Attributes:
        dt: a shorter time step at which it is stable; None if its own is, or if none helps.
        states: its run with a stable step, ``(time, field, *grid)``; None if there is none.
        diverges: time at which it leaves all bounds, with shorter steps as well; None if it does
            not.
    """

    dt: float | None = None
    states: Tensor | None = None
    diverges: float | None = None


@torch.no_grad()
def bounded_step(system: System, start: Tensor, times: Tensor, recorded: int) -> BoundedStep:
    """Return the longest stable time step of a corrected simulator: its own, or a shorter one.

    A step is stable if the run stays within bounds, and if rounding errors stay small
    (:mod:`.step_stability`).

    Args:
        system: the corrected simulator.
        start: its fitted start, ``(field, *grid)``.
        times: of the recording and the forecast, ``(time,)``.
        recorded: number of times of the recording.
    """
    has_steps = bool(system.axes) or system.tableau is not None
    before = -1
    for halvings in range(MAX_HALVINGS + 1 if has_steps else 1):
        stepped = system.with_step(system.dt / 2**halvings) if halvings else system
        [states] = simulate(stepped, start[None], times)
        lost = _lost(states, recorded)
        if lost is None and (not has_steps or _is_stable(stepped, states, times)):
            return BoundedStep(stepped.dt if halvings else None, states)
        if lost is not None and lost == before and lost > FEWEST_SAMPLES:
            break
        before = -1 if lost is None else lost
    return BoundedStep(diverges=None if lost is None else float(times[lost]))


def _lost(states: Tensor, recorded: int) -> int | None:
    """Return the first sample beyond all bounds; None without one.

    The bounds are far beyond the first half of the recording, in which the run follows the data.
    """
    size = states.abs().reshape(*states.shape[:2], -1).amax(dim=2)
    early = size[: max(1, recorded // 2)].nan_to_num(0.0, 0.0).amax(dim=0)
    # Written with "not", because the values may be NaN.
    lost = ~(size <= UNSTABLE * early.clamp(min=float(early.max()))).all(dim=1)
    return int(lost.int().argmax()) if lost.any() else None


def _is_stable(system: System, states: Tensor, times: Tensor) -> bool:
    """Return whether rounding errors stay small beside the largest state of the run."""
    end, begin = float(times[-1]), float(times[0])
    count = int((times <= end - STEPS * system.dt).sum())
    if not count:
        return True
    at = int(states[:count].flatten(1).norm(dim=1).argmax())
    along = Along(states[at : at + 1], times[at : at + 1], end, end - begin)
    return is_stable(system, along)
