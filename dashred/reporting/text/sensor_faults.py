"""A faulty sensor, as text."""

from collections.abc import Mapping

from dashred.core.findings.cause_schema import Cause, FaultySensor
from dashred.core.formatting import number, rounded
from dashred.core.units import NO_UNITS, TIME, format_unit, with_unit


def fault_text(fault: FaultySensor | Cause, units: Mapping[str, str] = NO_UNITS) -> str:
    """Return the fault in one sentence.

    Args:
        fault: the faulty sensor, or a cause that names one.
        units: by name of field, axis and ``t``.
    """
    text = _kind_text(fault, units)
    return text if fault["episode"] is None else f"{text}, in episode {fault['episode']!r}"


def _kind_text(fault: FaultySensor | Cause, units: Mapping[str, str]) -> str:
    sensor, std, time = fault["sensor"], fault["std"], units.get(TIME)
    value = " ± ".join(rounded(fault["value"], std)) if std else number(fault["value"])
    reading = with_unit(value, units.get(fault["reads"] or ""))
    match fault["fault"]:
        case "bias":
            return f"sensor {sensor} has a bias of {reading}"
        case "drift":
            per = f"per {format_unit(time) if time else 'unit time'}"
            return f"sensor {sensor} drifts by {reading} {per}"
        case "stuck":
            begin = with_unit(f"{fault['from']:.4g}", time)
            return f"sensor {sensor} is stuck at {reading} from t = {begin} on"
        case "spikes":
            count = round(fault["value"])
            return f"sensor {sensor} has {count} {'spike' if count == 1 else 'spikes'}"
    away = with_unit(value, units.get(fault["axis"] or ""))
    return f"sensor {sensor} is {away} away from its stated position"
