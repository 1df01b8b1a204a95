"""Checks of a system whose simulator is a program."""

from __future__ import annotations

from dashred.config.schema.types import Where
from dashred.core.errors import InputError, nearest
from dashred.physics.system_schema import System


def check_simulator(system: System, where: Where) -> None:
    """Check keys that belong to one kind of program, and what a program cannot have.

    Raises:
        InputError: a key has no effect, an axis has a condition for each side, or a name belongs to
            the files of a command.
    """
    simulator, key = system.simulator, "system.simulator"
    if simulator is None:
        return
    if simulator.template is not None and simulator.command is None:
        what = f"{key}.template is for a command, but there is none"
        raise InputError(what, where=where(f"{key}.template"), hint="remove it")
    if simulator.fmu is not None and system.axes:
        what, hint = "the fields of an FMU are numbers: it has no axes", "remove system.axes"
        raise InputError(what, where=where("system.axes"), hint=hint)
    if simulator.fmu is None and simulator.interface is not None:
        what = f"{key}.interface is for an FMU, but there is none"
        raise InputError(what, where=where(f"{key}.interface"), hint="remove it")
    for name in simulator.variables:
        own = {**system.fields, **system.parameters, **system.inputs}
        place = where(f"{key}.variables.{name}")
        if simulator.fmu is None:
            raise InputError(f"{key}.variables is for an FMU, but there is none", where=place)
        if name not in own:
            what = f"{key}.variables names {name}, which is not a field, parameter or input"
            raise InputError(what, where=place, hint=nearest(name, own))
    for name, axis in system.axes.items():
        if isinstance(axis.ends, dict) or axis.coordinates == "radial":
            what = "a program cannot have an axis with a condition for each side, or a radius"
            hint = "it has its own: for terms that assume none, give the points as system.nodes"
            raise InputError(what, where=where(f"system.axes.{name}"), hint=hint)
    if simulator.command is None:
        return
    # Imported here, because it takes long and few systems have a command.
    from dashred.physics.external.adapters.command.netcdf_files import OWN_NAMES

    for section in ("fields", "axes", "inputs", "parameters"):
        for name in getattr(system, section):
            if name in OWN_NAMES:
                what = f"{name!r} is a name of the files of a command and cannot be a name here"
                raise InputError(what, where=where(f"system.{section}.{name}"), hint=f"{name}_0")
