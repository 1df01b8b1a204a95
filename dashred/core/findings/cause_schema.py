"""The schema of the verdict and of its causes in the findings."""

from typing import Any, Literal, Required, TypedDict

Verdict = Literal[
    "missing-term",
    "nothing-missing",
    "parameter",
    "initial-condition",
    "sensor-fault",
    "unresolved-numerics",
    "outside-library",
    "ambiguous",
    "not-converged",
    "mismatch",
    "no-mismatch-seen",
    "unconfirmed",
]
"""The verdicts. A cause has one of these kinds, too, except for `unconfirmed`: the suggested law is
then less accurate on held-out data than the simulator from its own best start.
"""

NotConverged = Literal[
    "window-not-reached", "law-not-fitted", "law-incomplete", "misfit-unexplained", "budget"
]
"""Why a search did not converge. The fit of an incomplete law has ended, but all candidates
together explain more of the recording.
"""


class FaultCurve(TypedDict):
    """The error of a sensor's readings over time, with its standard deviation.

    `episode` is null for a recording of one episode.
    """

    episode: str | None
    times: list[float]
    value: list[float]
    std: list[float]


# `from` is a keyword of Python, so this cannot be written as a class.
FaultySensor = TypedDict(
    "FaultySensor",
    {
        "sensor": str,
        "fault": str,
        "value": float,
        "std": float | None,
        "from": float | None,
        "reads": str | None,
        "axis": str | None,
        "episode": str | None,
        "curve": list[FaultCurve] | None,
    },
)
"""A faulty sensor.

`fault` is a key of :data:`dashred.core.findings.fault_kinds.FAULT_KINDS`, which says what `value`
is. A sensor is stuck from time `from` on; a misplaced one is displaced along `axis`. `reads` is the
field that the sensor reads. `episode` is null for a fault in all episodes. `curve` is the error of
a wandering sensor in each episode, and null for the other kinds.
"""

Cause = TypedDict(
    "Cause",
    {
        "kind": Required[Verdict],
        "probability": Required[float | None],
        "where": dict[str, list[str]] | None,
        "says": str,
        # A law.
        "terms": list[str],
        "parameter": list[str],
        "extended": bool,
        # The name of a hidden state of this law.
        "hidden_state": str,
        # The equation of a localised source, whose terms these are.
        "source": str,
        # Distance of the initial state from its prior, in standard deviations of the prior.
        "start": float,
        # A faulty sensor: the keys of FaultySensor.
        "sensor": str,
        "fault": str,
        "value": float,
        "std": float | None,
        "from": float | None,
        "reads": str | None,
        "axis": str | None,
        "episode": str | None,
        "curve": list[FaultCurve] | None,
        # Outside the library: the evidence for a free forcing (with `unexplained` and `misfit`, see
        # below), the residuals of the best law in standard deviations of the traces, or the number
        # of further terms that it needs.
        "gain": float,
        "residual": float,
        "supported": int,
        # Not converged.
        "reason": NotConverged,
        "samples": int,
        "samples_in_all": int,
        "misfit": float,
        "misfit_of_all": float,
        # Probability that noise alone makes the misfit of all candidates so much lower.
        "chance": float,
        "unexplained": float,
        "budget": float,
        # Unresolved numerics.
        "doubling_error": float,
        "limit": float,
        "points": dict[str, int],
        "enough": dict[str, int] | None,
        # Snapshots: errors of SHRED on the recording and on unseen snapshots.
        "states": dict[str, Any],
        "changes": dict[str, Any],
        "increments_error": dict[str, float],
        "cannot_know": list[str],
    },
    total=False,
)
"""One cause, with the keys of its kind. `says` is the cause as text.

`probability` is the posterior share of the cause among all explanations that were fitted, times
1 − :data:`NONE_OF_THESE`. It is null for what is not one of them: an effect that only a free
forcing shows, a search that did not converge, and unresolved numerics.
"""

NONE_OF_THESE = 0.07
"""Probability that none of the fitted explanations is right.

It is the share of wrong leading causes among those with a posterior share above 0.98, for
recordings of fields and mechanics made by other solvers: 8 of 109 in the draw foreign-5.
"""
