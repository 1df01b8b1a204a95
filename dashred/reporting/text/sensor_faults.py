"""A faulty sensor, as text."""

from collections.abc import Mapping

from dashred.core.findings.cause_schema import Cause, FaultySensor
from dashred.core.findings.fault_kinds import FAULT_KINDS
from dashred.core.formatting import number, with_error
from dashred.core.units import NO_UNITS, TIME, format_unit, with_unit


def fault_text(fault: FaultySensor | Cause, units: Mapping[str, str] = NO_UNITS) -> str:
    """Return the fault in one sentence.

    Args:
        fault: the faulty sensor, or a cause that names one.
        units: by name of field, axis and ``t``.
    """
    std, time, count = fault["std"], units.get(TIME), round(fault["value"])
    value = with_error(fault["value"], std) if std else number(fault["value"])
    text = FAULT_KINDS[fault["fault"]].wording.format(
        sensor=fault["sensor"],
        reading=with_unit(value, units.get(fault["reads"] or "")),
        per_time=f"per {format_unit(time) if time else 'unit time'}",
        begin=_time(fault["from"], time),
        count=f"{count} {'spike' if count == 1 else 'spikes'}",
        distance=with_unit(value, units.get(fault["axis"] or "")),
        peak=_time(_peak(fault), time),
    )
    return text if fault["episode"] is None else f"{text}, in episode {fault['episode']!r}"


def _time(time: float | None, unit: str | None) -> str:
    return "" if time is None else with_unit(f"{time:.4g}", unit)


def _peak(fault: FaultySensor | Cause) -> float | None:
    """Return the time of the largest error of a wandering sensor; None without a curve."""
    points = [
        (abs(value), time)
        for curve in fault.get("curve") or []
        for value, time in zip(curve["value"], curve["times"], strict=True)
    ]
    return max(points)[1] if points else None
