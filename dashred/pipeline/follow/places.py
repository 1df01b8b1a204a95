"""Quantities that are estimated beside the sensors: fields at places."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.core.errors import InputError, nearest
from dashred.data.sensors import Sensor, check_sensor, observable_names
from dashred.physics.system import System

AT, BETWEEN = "@", ";"


def unmeasured_fields(system: System, sensors: Sequence[Sensor]) -> tuple[Sensor, ...]:
    """Return the fields of an ODE system that no sensor reads; none for a system with axes."""
    read = {sensor.reads for sensor in sensors}
    named = {sensor.name for sensor in sensors}
    if system.axes:
        return ()
    return tuple(Sensor(name, name) for name in system.fields if name not in read | named)


def parse_places(
    texts: Sequence[str], system: System, sensors: Sequence[Sensor]
) -> tuple[Sensor, ...]:
    """Return the quantities that the user names.

    Args:
        texts: ``u@1.5`` or ``u@1.5;2.0``: a field, or a let, with one coordinate for each axis;
            without axes its name alone.
        system: the simulator.
        sensors: of the run; their names cannot be used again.

    Raises:
        InputError: the system has no such quantity, or no such place.
    """
    found = []
    for text in texts:
        name, _, rest = text.partition(AT)
        if name not in observable_names(system):
            hint = nearest(name, observable_names(system))
            raise InputError(f"the system has no quantity {name!r}", where=f"at={text}", hint=hint)
        try:
            position = tuple(float(each) for each in rest.split(BETWEEN)) if rest else ()
        except ValueError:
            hint = f"for example at=FIELD{AT}1.5, and {BETWEEN} between the axes of a plane"
            raise InputError("this is not a place", where=f"at={text}", hint=hint) from None
        if text in {sensor.name for sensor in sensors}:
            raise InputError(f"a sensor is called {text!r}", where=f"at={text}")
        place = Sensor(text, name, position)
        check_sensor(place, system, f"at={text}")
        found.append(place)
    return tuple(found)
