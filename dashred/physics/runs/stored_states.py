"""States of trajectories on disk, which are read in parts and never held as a whole.

The functions below take states in memory, too. They compute those at once, so that a result does
not depend on blocks where none are needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, TypeAlias

import torch
from torch import Tensor

# States that are read at once.
BLOCK_BYTES = 2**26
Index: TypeAlias = int | slice


class StateReader(Protocol):
    """Trajectories on disk, of which any part can be read."""

    @property
    def shape(self) -> tuple[int, ...]:
        """``(member, time, field, *grid)``."""

    @property
    def chunk(self) -> int:
        """Number of samples of a member that are stored together."""

    def read(self, member: int, first: int, end: int) -> Tensor:
        """Return the states of a member from sample ``first`` to before ``end``, float64.

        Raises:
            InputError: they are missing or damaged.
        """


@dataclass(frozen=True)
class StoredStates:
    """States on disk. An index reads some of them, as it does in a tensor of the same shape.

    Attributes:
        reader: of the trajectories.
        members: those of the reader that belong to it, in order.
    """

    reader: StateReader
    members: Sequence[int]

    @property
    def shape(self) -> tuple[int, ...]:
        """``(member, time, field, *grid)``."""
        return (len(self.members), *self.reader.shape[1:])

    def __len__(self) -> int:
        """Return the number of members."""
        return len(self.members)

    def __getitem__(self, key: Index | tuple[Index, Index] | tuple[Tensor, Tensor]) -> Tensor:
        """Read ``states[member]``, ``states[member, time]``, or pairs of both as two tensors."""
        members, times = key if isinstance(key, tuple) else (key, slice(None))
        if isinstance(members, Tensor) and isinstance(times, Tensor):
            states = torch.empty((len(members), *self.shape[2:]), dtype=torch.float64)
            for row, (member, time) in enumerate(
                zip(members.tolist(), times.tolist(), strict=True)
            ):
                states[row] = self._read(self.members[member], time)
            return states
        assert not isinstance(members, Tensor) and not isinstance(times, Tensor)
        chosen = self.members[members]
        if isinstance(chosen, int):
            return self._read(chosen, times)
        if not chosen:
            return torch.zeros(self.shape, dtype=torch.float64)[:, times]
        return torch.stack([self._read(member, times) for member in chosen])

    def part(self, members: slice) -> StoredStates:
        """Return some members, without reading them."""
        return replace(self, members=self.members[members])

    def _read(self, member: int, times: Index) -> Tensor:
        if isinstance(times, int):
            time = range(self.shape[1])[times]
            return self.reader.read(member, time, time + 1)[0]
        first, end, step = times.indices(self.shape[1])
        return self.reader.read(member, first, end)[::step]


@dataclass(frozen=True)
class JoinedReader:
    """The trajectories of several readers of equal shape, one after another.

    Attributes:
        parts: states of each.
    """

    parts: Sequence[StoredStates]

    @property
    def shape(self) -> tuple[int, ...]:
        """``(member, time, field, *grid)``."""
        return (sum(map(len, self.parts)), *self.parts[0].shape[1:])

    @property
    def chunk(self) -> int:
        """Number of samples of a member that are stored together."""
        return self.parts[0].reader.chunk

    def read(self, member: int, first: int, end: int) -> Tensor:
        """See :meth:`StateReader.read`."""
        for states in self.parts:
            if member < len(states):
                return states[member, first:end]
            member -= len(states)
        raise IndexError(member)


States: TypeAlias = Tensor | StoredStates


@dataclass(frozen=True)
class SegmentReader:
    """Segments of trajectories, as trajectories of their own.

    Attributes:
        states: the whole trajectories.
        length: samples of a segment; what is left at the end of a trajectory is not read.
    """

    states: StoredStates
    length: int

    @property
    def _each(self) -> int:
        return self.states.shape[1] // self.length

    @property
    def shape(self) -> tuple[int, ...]:
        """``(segment, time, field, *grid)``."""
        return (len(self.states) * self._each, self.length, *self.states.shape[2:])

    @property
    def chunk(self) -> int:
        """Number of samples of a trajectory that are stored together."""
        return self.states.reader.chunk

    def read(self, member: int, first: int, end: int) -> Tensor:
        """See :meth:`StateReader.read`."""
        row, place = divmod(member, self._each)
        begin = place * self.length
        return self.states[row, begin + first : begin + end]


class Block(NamedTuple):
    """States that are in memory together, ``(member, time, field, *grid)``, and their place."""

    members: slice
    times: slice
    states: Tensor


def part(states: States, members: slice) -> States:
    """Return some members of states, without reading them."""
    return states[members] if isinstance(states, Tensor) else states.part(members)


def cut(states: States, length: int) -> States:
    """Return segments of ``length`` samples as members, without what is left at the end."""
    each = states.shape[1] // length
    if isinstance(states, Tensor):
        return states[:, : each * length].unflatten(1, (each, length)).flatten(0, 1)
    segments = SegmentReader(states, length)
    return StoredStates(segments, range(segments.shape[0]))


def thinned(states: States, count: int) -> Tensor:
    """Return at least ``count`` states of all members and times, at a stride, or all of fewer."""
    stride = max(1, math.prod(states.shape[:2]) // count)
    if isinstance(states, Tensor):
        return states.flatten(0, 1)[::stride]
    rows = torch.arange(0, math.prod(states.shape[:2]), stride)
    return states[rows // states.shape[1], rows % states.shape[1]]


def blocks(states: States) -> Iterator[Block]:
    """Yield states block by block; states in memory are one block."""
    if isinstance(states, Tensor):
        yield Block(slice(0, len(states)), slice(0, states.shape[1]), states)
        return
    samples, size = states.shape[1], 8 * math.prod(states.shape[2:])
    chunk = states.reader.chunk
    length = chunk * max(1, BLOCK_BYTES // (size * chunk))
    for row in range(len(states)):
        for first in range(0, samples, length):
            times = slice(first, min(first + length, samples))
            yield Block(slice(row, row + 1), times, states[row, times][None])


def each_state(function: Callable[[Tensor], Tensor], states: States) -> Tensor:
    """Return ``function(states)``, computed block by block where they are on disk.

    Args:
        function: maps states ``(member, time, field, *grid)`` to values ``(member, time, *rest)``,
            those of a state from this state alone.
        states: the states.
    """
    if isinstance(states, Tensor):
        return function(states)
    if not len(states):
        return function(states[:, :])
    values = None
    for block in blocks(states):
        found = function(block.states)
        if values is None:
            values = found.new_empty((*states.shape[:2], *found.shape[2:]))
        values[block.members, block.times] = found
    assert values is not None
    return values


def rms_of_fields(states: States) -> Tensor:
    """Return the rms of each field over all members and times, ``(field,)``."""
    total, count = torch.zeros(()), math.prod(states.shape[:2])
    for block in blocks(states):
        flat = block.states.flatten(0, 1)
        share = len(flat) / count
        total = total + share * flat.transpose(0, 1).flatten(1).square().mean(dim=1)
    return total.sqrt()
