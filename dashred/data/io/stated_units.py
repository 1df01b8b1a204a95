"""Consistency of the units in a recording with the configuration and with each other."""

from __future__ import annotations

from dataclasses import dataclass, field

from dashred.core.units import check_same_unit
from dashred.data.sensors import SystemDescription


@dataclass
class StatedUnits:
    """Collects the units stated in the files of a recording.

    Attributes:
        system: with the units of the configuration.
        units: by name in the equations; the unit of time is under ``t``.
        places: location of the first statement of each unit.
    """

    system: SystemDescription
    units: dict[str, str] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)

    def state(self, name: str, unit: str | None, where: str, what: str | None = None) -> None:
        """Record the unit of a name; None records nothing.

        Args:
            name: in the equations, or ``t``.
            unit: as written.
            where: file, line and column.
            what: description for error messages; the name by default.

        Raises:
            InputError: the unit differs from the configuration, or from another statement in
                the recording; the message gives both locations.
        """
        if unit is None:
            return
        what, key = what or name, f"system.units.{name}"
        check_same_unit(what, unit, where, self.system.units.get(name), self.system.where(key))
        check_same_unit(what, unit, where, self.units.get(name), self.places.get(name, ""))
        self.units.setdefault(name, unit)
        self.places.setdefault(name, where)
