"""Units that a recording states, held against the configuration's and against each other."""

from __future__ import annotations

from dataclasses import dataclass, field

from dashred.core.units import check_same
from dashred.data.sensors import Described


@dataclass
class StatedUnits:
    """Collects what the files of a recording say of units.

    Attributes:
        system: what the configuration says.
        units: by name in the equations, that of time as ``t``.
        places: where each was stated first.
    """

    system: Described
    units: dict[str, str] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)

    def state(self, name: str, unit: str | None, where: str, what: str | None = None) -> None:
        """Take note that what a name stands for is in this unit; None says nothing.

        Args:
            name: in the equations, or ``t``.
            unit: as it is written.
            where: file, line and column.
            what: what a reader calls it; the name, if not given.

        Raises:
            InputError: the configuration, or the recording itself in another place, says
                otherwise; both places are named.
        """
        if unit is None:
            return
        what, key = what or name, f"system.units.{name}"
        check_same(what, unit, where, self.system.units.get(name), self.system.where(key))
        check_same(what, unit, where, self.units.get(name), self.places.get(name, ""))
        self.units.setdefault(name, unit)
        self.places.setdefault(name, where)
