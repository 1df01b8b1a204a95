"""Collection and checks of the units stated in a system's declaration."""

from __future__ import annotations

from dashred.config.layers import where_in
from dashred.core.errors import InputError, nearest
from dashred.core.units import TIME, check_same_unit, check_unit, split_unit
from dashred.physics.system_schema import System


def collect_units(system: System, lines: dict[str, str]) -> None:
    """Move units in the descriptions of fields to ``system.units``, and check all units.

    Args:
        system: declaration, changed in place.
        lines: location of each dotted key; the locations of moved units are added.

    Raises:
        InputError: a unit is invalid, belongs to an unknown name, or contradicts another unit of
            the same field.
    """
    where = where_in(lines)
    parts = (system.fields, system.axes, system.parameters, system.let, system.inputs)
    known = [TIME, *(name for part in parts for name in part)]
    for name, unit in system.units.items():
        key = f"system.units.{name}"
        if name not in known:
            what = f"system.units names {name}, which the system does not have"
            raise InputError(what, where=where(key), hint=nearest(name, known))
        system.units[name] = check_unit(unit, name, where(key))
    for name, text in system.fields.items():
        meaning, behind = split_unit(text)
        if behind is None:
            continue
        place = where(f"system.fields.{name}")
        check_unit(behind, name, place)
        check_same_unit(name, behind, place, system.units.get(name), where(f"system.units.{name}"))
        system.fields[name] = meaning
        if name not in system.units:
            system.units[name], lines[f"system.units.{name}"] = behind, place
