"""Runs of a black-box simulator that are read from their file in parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
import torch
from torch import Tensor

from dashred.physics.black_box.snapshots import Snapshots

# Samples of one field that are hashed at once take so many bytes.
HASHED_BYTES = 2**26


@dataclass(frozen=True)
class SnapshotReader:
    """Random runs at the step of the clock (:class:`.runs.stored_states.StateReader`).

    Attributes:
        snapshots: the open file.
        chosen: numbers of the runs in it, in order.
        stride: steps between snapshots in a step of the clock.
        shape: ``(member, time, field, *grid)``.
    """

    snapshots: Snapshots
    chosen: Sequence[int]
    stride: int
    shape: tuple[int, ...]

    @classmethod
    def of(
        cls, snapshots: Snapshots, members: int, every: float, rng: np.random.Generator
    ) -> SnapshotReader:
        """Return the runs that :meth:`.snapshots.Snapshots.read` reads with these arguments."""
        chosen = rng.permutation(snapshots.members)[:members].tolist()
        system = snapshots.system
        shape = (
            len(chosen),
            snapshots.samples_at(every),
            len(system.fields),
            *system.grid.shape,
        )
        return cls(snapshots, chosen, snapshots.stride(every), shape)

    @property
    def chunk(self) -> int:
        """Number of samples of a run that are stored together, at the step of the clock."""
        variable = self.snapshots.dataset[self.snapshots.system.fields[0]]
        chunks = variable.encoding.get("chunks") or variable.encoding.get("chunksizes")
        if not chunks:
            return 1
        stored = dict(zip(variable.dims, chunks, strict=True))["time"]
        return max(1, min(self.shape[1], stored // self.stride))

    def read(self, member: int, first: int, end: int) -> Tensor:
        """See :meth:`.runs.stored_states.StateReader.read`.

        Raises:
            InputError: the file is damaged, or a value is not finite.
        """
        system = self.snapshots.system
        states = [
            torch.from_numpy(self._values(field, member, first, end)) for field in system.fields
        ]
        return system.grid.ring(torch.stack(states, dim=1))

    def sha256(self) -> str:
        """Read all values once and return their hash, that of :meth:`.snapshots.Snapshots.read`.

        Raises:
            InputError: the file is damaged, or a value is not finite.
        """
        digest, samples = sha256(), self.shape[1]
        points = np.prod(self.shape[3:], dtype=int)
        length = self.chunk * max(1, HASHED_BYTES // (8 * int(points) * self.chunk))
        for member in range(self.shape[0]):
            for field in self.snapshots.system.fields:
                for first in range(0, samples, length):
                    values = self._values(field, member, first, min(first + length, samples))
                    digest.update(np.ascontiguousarray(values, "<f8").tobytes())
        return digest.hexdigest()

    def _values(self, field: str, member: int, first: int, end: int) -> np.ndarray:
        samples = slice(first * self.stride, (end - 1) * self.stride + 1, self.stride)
        return self.snapshots.values(field, self.chosen[member], samples)
