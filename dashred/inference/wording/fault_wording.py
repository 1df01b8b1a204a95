"""What is wrong with a sensor, in one sentence."""

from __future__ import annotations

from collections.abc import Mapping

from dashred.core.formatting import number, rounded
from dashred.core.units import NO_UNITS, TIME, format_unit, with_unit
from dashred.inference.fit.law import SensorFault


def fault_in_words(
    fault: SensorFault,
    reads: str | None = None,
    units: Mapping[str, str] = NO_UNITS,
    place: str | None = None,
) -> str:
    """Return what is wrong with the sensor in one sentence.

    Args:
        fault: the fault.
        reads: the field or let that the sensor reads.
        units: by name.
        place: the axis along which it may be misplaced.
    """
    value, std = rounded(fault.value, fault.std) if fault.std else (number(fault.value), None)
    told, unit, time = value + (f" ± {std}" if std else ""), units.get(reads or ""), units.get(TIME)
    reading = with_unit(told, unit)
    match fault.kind:
        case "bias":
            return f"sensor {fault.sensor} reads {reading} too much"
        case "drift":
            per = f"per {format_unit(time) if time else 'unit time'}"
            return f"sensor {fault.sensor} drifts by {reading} {per}"
        case "stuck":
            begin = with_unit(f"{fault.begin:.4g}", time)
            return f"sensor {fault.sensor} is stuck at {reading} from t = {begin} on"
        case "spikes":
            count = round(fault.value)
            samples = "1 sample that is no reading"
            if count != 1:
                samples = f"{count} samples that are no readings"
            return f"sensor {fault.sensor} has {samples}"
    away = with_unit(told, units.get(place or ""))
    return f"sensor {fault.sensor} stands {away} from where it is said to"
