"""What a check says of a mesh."""

from __future__ import annotations

from collections.abc import Iterator

from dashred.physics.grids.mesh import Mesh
from dashred.physics.grids.stencils import stencil_size
from dashred.physics.system import System
from dashred.pipeline.check.remark import Remark

NOT_AVAILABLE = (
    "derivatives of more than second order, inv_lap, upwind fluxes, doubling of the resolution in "
    "space, and regions other than an interval of one coordinate"
)


def node_remarks(system: System) -> Iterator[Remark]:
    """Describe the nodes of a system, and say what is not available on them."""
    mesh = system.grid
    if not isinstance(mesh, Mesh):
        return
    extents = " and ".join(
        f"{axis.name} from {axis.begin:.4g} to {axis.begin + axis.length:.4g}" for axis in mesh.axes
    )
    yield Remark(
        f"The fields are at {mesh.shape[0]} nodes, {extents}, typically {mesh.spacing:.2g} apart; "
        f"a derivative is taken from {stencil_size(len(mesh.axes))} of them"
    )
    yield Remark(f"Not available on nodes: {NOT_AVAILABLE}")
