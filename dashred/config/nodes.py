"""The coordinates of a system whose fields are at the nodes of a mesh."""

from __future__ import annotations

from dashred.config.schema.types import Where
from dashred.core.errors import InputError
from dashred.physics.system_schema import Axis, System

OPEN = "open"
# The dimension of a field.
NODE = "node"
# Fewest points of an axis. Here the points only say how large the problem is.
FEWEST_POINTS = 8


def coordinates_of_nodes(system: System, where: Where) -> dict[str, Axis]:
    """Return the coordinates of the nodes, as axes that are open at both ends.

    Raises:
        InputError: the nodes cannot be used, or the system has something that needs a grid.
    """
    place = where("system.nodes")
    if system.axes:
        what = "system.axes and system.nodes are both given"
        hint = "remove axes: the coordinates are those of the nodes, and the program has its own "
        raise InputError(what, where=place, hint=hint + "conditions at its boundaries")
    if system.simulator is None:
        what = "nodes are for a simulator that is a program: equations need axes"
        raise InputError(what, where=place, hint="give system.simulator, or axes in place of nodes")
    if system.simulator.fmu is not None:
        raise InputError("the fields of an FMU are numbers: it has no nodes", where=place)
    if system.structure is not None:
        what = "system.structure is the form of equations, and a program on nodes has none"
        raise InputError(what, where=where("system.structure"), hint="remove it")
    if system.front is not None:
        what = "system.front needs a system with one periodic axis"
        raise InputError(what, where=where("system.front"), hint="remove it")
    for section in ("fields", "parameters", "inputs"):
        if NODE in getattr(system, section):
            what = f"{NODE!r} is the dimension of fields at nodes, and cannot be a name"
            raise InputError(what, where=where(f"system.{section}.{NODE}"), hint=f"{NODE}_0")
    # Imported here, because few systems have nodes.
    from dashred.physics.grids.nodes_file import read_nodes

    coordinates = read_nodes(system.nodes or "")
    count = len(next(iter(coordinates.values())))
    points = max(FEWEST_POINTS, round(count ** (1 / len(coordinates))))
    return {
        name: Axis(length=float(max(x) - min(x)), points=points, ends=OPEN)
        for name, x in coordinates.items()
    }
