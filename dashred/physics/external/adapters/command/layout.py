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
        dimensions: of a field, in their order; none for an ODE.
        coordinates: dimension and values of each coordinate, by name.
        units: by name of a field, coordinate or input, and of time as ``t``.
    """

    fields: tuple[str, ...]
    dimensions: tuple[str, ...]
    coordinates: Mapping[str, tuple[str, Array]]
    units: Mapping[str, str]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points along each dimension."""
        sizes = {dimension: len(values) for dimension, values in self.coordinates.values()}
        return tuple(sizes[dimension] for dimension in self.dimensions)
