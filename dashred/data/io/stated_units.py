"""Units in the files of a recording: values in another unit than the configuration's are converted.

The unit of a quantity is that of the configuration, or else the first one in the recording.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from dashred.core.unit_conversion import UNCHANGED, Conversion, conversion
from dashred.data.sensors import SystemDescription


@dataclass
class StatedUnits:
    """Collects the units stated in the files of a recording.

    Attributes:
        system: with the units of the configuration.
        units: by name in the equations; the unit of time is under ``t``. Values have these units
            after conversion.
        places: location of the first statement of each unit.
    """

    system: SystemDescription
    units: dict[str, str] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)

    def state(self, name: str, unit: str | None, where: str, what: str | None = None) -> Conversion:
        """Record the unit of a name, and return how values in it are converted.

        Args:
            name: in the equations, or ``t``.
            unit: as written; None records nothing.
            where: file, line and column.
            what: description for error messages; the name by default.

        Raises:
            InputError: the unit cannot be converted to that of the configuration, or of another
                statement in the recording; the message gives both locations.
        """
        if unit is None:
            return UNCHANGED
        known, place = self.system.units.get(name), self.system.where(f"system.units.{name}")
        if known is None and name in self.units:
            known, place = self.units[name], self.places[name]
        found = UNCHANGED
        if known is not None:
            found = conversion(what or name, unit, where, known, place)
        self.units.setdefault(name, unit if known is None or found == UNCHANGED else known)
        self.places.setdefault(name, where)
        return found
