"""Values of fields at all points of a staggered axis, from their cells and their conditions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.boundaries.conditions import Sides
from dashred.physics.boundaries.entries import SIDES
from dashred.physics.boundaries.responses import response_name
from dashred.physics.grids.grid import Axis
from dashred.physics.grids.staggered import face_values

Array = NDArray[np.float64]


class Extension:
    """``f = P c + Σ_s g_s(t) E_s`` for every field; see :func:`.grids.staggered.face_values`.

    Attributes:
        matrices: P, ``(field, point, cell)``.
        responses: E by name, ``(point,)``.

    Args:
        axis: a staggered axis.
        conditions: of every field, by side, in t and inputs. The centre of a radius has none.
        input_signals: of the system.
    """

    def __init__(
        self, axis: Axis, conditions: Mapping[str, Sides], input_signals: InputSignals
    ) -> None:
        self._signals = input_signals
        self.matrices = np.zeros((len(conditions), axis.ring_points, axis.points))
        self.responses: dict[str, Tensor] = {}
        for index, (field, sides) in enumerate(conditions.items()):
            kinds = [sides[side].kind if side in sides else "slope" for side in SIDES]
            self.matrices[index], found = face_values(axis.points, 2 * axis.spacing, *kinds)
            for side in sides:
                self.responses[response_name(field, side)] = torch.from_numpy(found[side])
        self._given = Pointwise([c.given for sides in conditions.values() for c in sides.values()])
        self._fields = list(conditions)
        owners = [i for i, sides in enumerate(conditions.values()) for _ in sides]
        # E of every condition, in the equation of its field: (condition, field, point).
        self._spread = np.zeros((len(owners), len(conditions), axis.ring_points))
        for k, (owner, response) in enumerate(zip(owners, self.responses.values(), strict=True)):
            self._spread[k, owner] = response.numpy()

    def given(self, t: Array) -> Array:
        """Return ``Σ_s g_s(t) E_s``, ``(time, field, point)``, at times ``(time,)``."""
        found: Array = np.tensordot(self.values(t), self._spread, axes=1)
        return found

    @property
    def count(self) -> int:
        """Number of conditions."""
        return len(self._spread)

    def values(self, t: Array) -> Array:
        """Return the given values and slopes g, ``(*time, condition)``."""
        return np.ascontiguousarray(
            np.moveaxis(self._given({"t": t, **self._signals.at(t)}, t.shape), 0, -1)
        )

    def effects(self, field: str) -> Array:
        """Return E of every condition in one field, ``(condition, point)``."""
        found: Array = self._spread[:, self._fields.index(field)]
        return found

    def cells(self, state: Tensor) -> Tensor:
        """Return the cells ``(…, field, cell)`` of fields ``(…, field, point)``."""
        return state[..., 1::2]

    def homogeneous(self, cells: Tensor) -> Tensor:
        """Return ``P c``, ``(…, field, point)``, for cells ``(…, field, cell)``."""
        matrices = torch.from_numpy(self.matrices)
        return torch.einsum("fpc,...fc->...fp", matrices, cells)

    def whole(self, cells: Tensor, t: float) -> Tensor:
        """Return the fields at all points, ``(…, field, point)``, at one time."""
        return self.homogeneous(cells) + torch.from_numpy(self.given(np.array([t]))[0])
