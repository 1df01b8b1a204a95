"""Whether the held-out data contradict a law, or that only sensors err."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median

from dashred.core.findings.cause_schema import Cause, Verdict
from dashred.core.findings.fit_schema import Comparison, FaultContradiction
from dashred.inference.fit.law import Law
from dashred.pipeline.verification.comparison import SATURATED

# If only sensors err, the error at a test sensor is below this many standard deviations of noise.
# The uncertainty of the start adds to it.
MAX_MISFIT = 3.0
# An error in held-out time of less than this many standard deviations of noise is noise alone.
NOISE_ALONE = 1.2
# A verdict that states a law may be rejected by held-out data.
LAWS: tuple[Verdict, ...] = ("missing-term", "parameter", "outside-library", "ambiguous")


def is_law_contradicted(
    verdict: Verdict, causes: Sequence[Cause], law: Law, comparisons: Sequence[Comparison]
) -> bool:
    """Return whether the verdict states a law, and it is less accurate on some held-out data.

    That an effect is outside of the library is not contradicted by the failure of the nearest law.

    Args:
        verdict: of the search.
        causes: of the verdict, the leading one first.
        law: the best law.
        comparisons: of the held-out data.
    """
    if verdict not in LAWS or not law.candidates:
        return False
    is_nearest = verdict == "outside-library" and "terms" not in causes[0]
    return not is_nearest and any(each["worse"] for each in comparisons)


def contradiction_of_faults(
    comparisons: Sequence[Comparison], misfits: Mapping[str, float], is_local: bool, noise: float
) -> FaultContradiction | None:
    """Return how held-out data contradict that only sensors err; None if they do not.

    If only sensors err, the simulator is right. It then predicts the sound sensors better than a
    constant would. It also agrees with the sensors that no fit has used. One of these may err
    itself, but not beside a fitted sensor that errs.

    Args:
        comparisons: of the held-out data.
        misfits: of the test sensors, as returned by :func:`.comparison.misfits_at_sensors`.
        is_local: whether sensors that no fit has used err next to fitted sensors that err.
        noise: σ of the sensors, in standard deviations of their readings.
    """
    # Of readings that are nearly all noise, the right simulator is not better than a constant.
    useless = max(SATURATED, NOISE_ALONE * noise)
    if comparisons and not any(each["after"] < useless for each in comparisons):
        return "no-better-than-mean"
    is_missed = bool(misfits) and median(misfits.values()) > MAX_MISFIT
    return "other-sensors" if is_missed or is_local else None
