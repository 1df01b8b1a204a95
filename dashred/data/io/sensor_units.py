"""The units of sensors in a table: in its header, or in the table of sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashred.core.unit_conversion import Conversion
from dashred.core.units import check_same_unit, check_unit
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.columns import Columns
from dashred.data.sensors import Sensor


def convert_sensors(
    sensors: Sequence[Sensor], table: Columns, places: Columns | None, stated: StatedUnits
) -> tuple[list[Sensor], list[Conversion]]:
    """Return the sensors with converted noise, and the conversion of the readings of each.

    Args:
        sensors: in the order of their columns.
        table: the recording.
        places: the table of sensors; None if there is none.
        stated: takes note of the units.

    Raises:
        InputError: two units of one sensor differ, or a unit cannot be converted.
    """
    rows = {} if places is None else {name: i for i, name in enumerate(places.texts("name"))}
    own_units = places.texts("unit") if places and "unit" in places.columns else []
    unit_of_std = None if places is None else places.units.get("std")
    converted, conversions = [], []
    for sensor in sensors:
        what, unit = f"sensor {sensor.name!r}", table.units.get(sensor.name)
        where = table.header_location(sensor.name)
        if own_units and places and (own := own_units[rows[sensor.name]]):
            own_where = places.location(rows[sensor.name], "unit")
            own = check_unit(own, what, own_where)
            if unit is not None:
                check_same_unit(what, unit, where, own, own_where)
            unit, where = own, own_where
        std_where = "" if places is None else places.header_location("std")
        own_sensor, convert = convert_sensor(sensor, unit, where, unit_of_std, std_where, stated)
        converted.append(own_sensor)
        conversions.append(convert)
    return converted, conversions


def convert_sensor(
    sensor: Sensor,
    unit: str | None,
    where: str,
    unit_of_std: str | None,
    std_where: str,
    stated: StatedUnits,
) -> tuple[Sensor, Conversion]:
    """Return a sensor with converted noise, and the conversion of its readings.

    Args:
        sensor: with its noise as written.
        unit: of its readings, as written; None if none is stated.
        where: location of this unit.
        unit_of_std: of its noise; None for the unit of its readings.
        std_where: location of that unit.
        stated: takes note of the units.

    Raises:
        InputError: a unit cannot be converted.
    """
    what = f"sensor {sensor.name!r}"
    found = stated.state(sensor.reads, unit, where, what)
    factor = found.factor
    if unit_of_std is not None:
        factor = stated.state(sensor.reads, unit_of_std, std_where, f"the std of {what}").factor
    return replace(sensor, std=None if sensor.std is None else factor * sensor.std), found
