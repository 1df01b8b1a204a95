"""What the files of a command contain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dashred.physics.external.state_batch import Array


@dataclass(frozen=True)
class Layout:
    """Names, places and units of a system.

    Attributes:
        fields: in their order.
        axes: places of the grid points by axis, in their order; none for an ODE.
        units: by name of a field, axis or input, and of time as ``t``.
    """

    fields: tuple[str, ...]
    axes: Mapping[str, Array]
    units: Mapping[str, str]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points along each axis."""
        return tuple(len(places) for places in self.axes.values())
