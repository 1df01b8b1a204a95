"""What ``dashred follow`` says about its filter and its alarms, in plain words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dashred.inference.streaming.calibration import Calibration
from dashred.inference.streaming.tracker import Alarm


def alarm_text(alarm: Alarm, names: Sequence[str], is_at_begin: bool) -> str:
    """Return a sentence on an alarm.

    Args:
        alarm: the alarm.
        names: of the sensors.
        is_at_begin: whether the readings have never agreed with the filter.
    """
    named = _listed([names[index] for index in alarm.sensors])
    when = f"at t = {alarm.time:g}, since t = {alarm.since:g}"
    if alarm.kind == "ended":
        return f"the alarm ends at t = {alarm.time:g}: {named or 'the readings'} as expected again"
    if is_at_begin and alarm.kind in ("several", "only"):
        return (
            f"ALARM {when}: the readings have not agreed with this system since the start. Do they "
            "come from another system, or have other units?"
        )
    if alarm.kind == "begun":
        verb = "differ" if len(alarm.sensors) > 1 else "differs"
        return f"ALARM {when}: {named or 'the sum of all sensors'} {verb} from the filter"
    if alarm.kind == "sensor":
        return (
            f"ALARM {when}: {named} differs from what the other sensors say: this sensor alone "
            "begins to fail. It is left out until it agrees again"
        )
    if alarm.kind == "only":
        return (
            f"ALARM {when}: {named} differs from the corrected simulator. With one sensor a fault "
            "of the sensor and a change of the physics cannot be told apart"
        )
    who = f"{named} differ" if named else "the sum of all sensors differs"
    if len(alarm.sensors) == 1:
        who = f"{named} and the sum of all sensors differ"
    return (
        f"ALARM {when}: {who} from the corrected simulator, and no single sensor explains it: the "
        "physics has changed"
    )


def calibration_text(calibration: Calibration, names: Sequence[str]) -> list[str]:
    """Return lines on the estimator, and on what its innovations were in the recording."""
    white = calibration.innovations
    lines = [f"{calibration.filter.description}; chosen on the recording of the run"]
    needed = np.flatnonzero(white.is_needed).tolist()
    if needed:
        shown = [
            f"{names[i]} (mean {white.mean[i]:.2g}, standard deviation {white.std[i]:.3g}, "
            f"correlation {white.correlation[i]:.2g})"
            for i in needed
        ]
        lines.append(
            f"in its {calibration.samples} samples the innovations of these sensors are not white "
            f"noise of unit variance, and are whitened: {', '.join(shown)}"
        )
    else:
        lines.append(
            f"in its {calibration.samples} samples the innovations are white noise of unit variance"
        )
    return lines


def _listed(names: Sequence[str]) -> str:
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"
