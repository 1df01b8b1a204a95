"""The kinds of sensor faults, with their wording.

The search for faults, the texts, the figures and the twin experiments use this one table.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FaultKind:
    """A kind of sensor fault.

    Attributes:
        value: what ``value`` of a fault in the findings is.
        wording: the fault as text. The names in braces are filled in by
            :func:`dashred.reporting.text.sensor_faults.fault_text`.
    """

    value: str
    wording: str


FAULT_KINDS = {
    "bias": FaultKind("the offset", "sensor {sensor} has a bias of {reading}"),
    "drift": FaultKind(
        "the change per unit time", "sensor {sensor} drifts by {reading} {per_time}"
    ),
    "stuck": FaultKind(
        "the reading at which it is stuck",
        "sensor {sensor} is stuck at {reading} from t = {begin} on",
    ),
    "spikes": FaultKind("their number", "sensor {sensor} has {count}"),
    "misplaced": FaultKind(
        "the distance from the stated position",
        "sensor {sensor} is {distance} away from its stated position",
    ),
    "wandering": FaultKind(
        "the largest error of its readings",
        "the readings of sensor {sensor} wander: their largest error is {reading}, at t = {peak}",
    ),
}
