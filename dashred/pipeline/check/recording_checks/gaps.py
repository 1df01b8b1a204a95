"""Irregular steps of the clock of a recording, gaps and interruptions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.core.formatting import plural
from dashred.data.clocks.interruptions import interruptions
from dashred.data.clocks.resampling import MAX_GAP, native_step
from dashred.data.recording import Recording
from dashred.pipeline.check.remark import Remark, warning

# Relative deviation from the mean step above which a clock is irregular.
IRREGULAR = 0.05
# An interval longer than this many steps is a gap if the samples keep their times.
MAX_GAP_KEPT = 10.0
# With this many gaps the sampling is uneven rather than interrupted.
MANY_GAPS = 5
RESTARTED = "if the system was restarted there, declare the parts as episodes"


def irregular_step_remarks(recording: Recording) -> Iterator[Remark]:
    """Warn of steps that vary."""
    step, steps = native_step(recording.times), np.diff(recording.times)
    usual = steps[steps <= MAX_GAP * step]
    if usual.size and np.abs(usual / step - 1).max() > IRREGULAR:
        shortest, longest = f"{usual.min():.4g}", f"{usual.max():.4g}"
        yield warning(
            f"The time steps vary from {shortest} to {longest}: values are interpolated",
            "recording.every=STEP sets the step of the analysis clock",
        )


def gap_remarks(recording: Recording, every: float | None) -> Iterator[Remark]:
    """Describe intervals that a clock does not bridge."""
    longest = MAX_GAP * max(native_step(recording.times), every or 0.0)
    gaps = np.flatnonzero(np.diff(recording.times) > longest)
    if not gaps.size:
        return
    longer = f"a longer step bridges short gaps: recording.every={longest:.3g}"
    hint = RESTARTED if gaps.size < MANY_GAPS else longer
    yield _gap_warning(recording, gaps, MAX_GAP, f"gaps are not interpolated; {hint}")


def interruption_remarks(
    recording: Recording, others: Sequence[NDArray[np.float64]]
) -> Iterator[Remark]:
    """Describe interruptions; many of them are an uneven sampling."""
    step = native_step(recording.times)
    gaps = interruptions(recording.times, MAX_GAP_KEPT * step, others)
    if 0 < gaps.size < MANY_GAPS:
        yield _gap_warning(recording, gaps, MAX_GAP_KEPT, RESTARTED)


def _gap_warning(recording: Recording, gaps: NDArray[np.intp], longer: float, hint: str) -> Remark:
    """Return a warning of gaps, ``(gap,)`` samples, that are longer than some steps."""
    steps = np.diff(recording.times)
    worst = int(gaps[steps[gaps].argmax()])
    text = f"{plural(gaps.size, 'gap')} longer than {longer:g} steps; the longest, "
    return warning(f"{text}{steps[worst]:.4g}, starts at t = {recording.times[worst]:.6g}", hint)
