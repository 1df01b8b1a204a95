"""States on disk, read in parts: the same as in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from dashred.physics.runs import stored_states
from dashred.physics.runs.stored_states import (
    JoinedReader,
    StoredStates,
    blocks,
    cut,
    each_state,
    part,
    rms_of_fields,
    thinned,
)

SHAPE = (5, 11, 2, 6)


@dataclass(frozen=True)
class TensorReader:
    """A reader of a tensor."""

    tensor: Tensor
    chunk: int = 3

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the tensor."""
        return tuple(self.tensor.shape)

    def read(self, member: int, first: int, end: int) -> Tensor:
        """Read a part that is not empty."""
        assert 0 <= first < end <= self.shape[1]
        return self.tensor[member, first:end].clone()


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    # Four states: a chunk has three of them.
    monkeypatch.setattr(stored_states, "BLOCK_BYTES", 4 * 8 * 12)


@pytest.fixture
def states() -> Tensor:
    return torch.randn(SHAPE, generator=torch.Generator().manual_seed(0)).double()


def stored(states: Tensor) -> StoredStates:
    return StoredStates(TensorReader(states), range(len(states)))


INDICES: dict[str, Callable[[Tensor], object]] = {
    "a member": lambda s: s[2],
    "the last member": lambda s: s[-1],
    "a sample": lambda s: s[1, 4],
    "a sample of all": lambda s: s[:, 3],
    "the last sample of all": lambda s: s[:, -1],
    "first samples": lambda s: s[:, :4],
    "part of a member": lambda s: s[3, 2:9],
    "every third": lambda s: s[1:4, ::3],
    "pairs": lambda s: s[torch.tensor([4, 0, 4]), torch.tensor([10, 0, 3])],
}


@pytest.mark.parametrize("index", INDICES)
def test_an_index_reads_what_it_reads_of_a_tensor(states: Tensor, index: str) -> None:
    read = INDICES[index]
    assert torch.equal(read(stored(states)), read(states))  # type: ignore[arg-type]


def test_blocks_cover_all_states_once_and_are_small(states: Tensor) -> None:
    found = torch.full(SHAPE, torch.nan).double()
    for block in blocks(stored(states)):
        assert block.states.shape[:2].numel() <= 4
        assert found[block.members, block.times].isnan().all()
        found[block.members, block.times] = block.states
    assert torch.equal(found, states)
    [whole] = blocks(states)
    assert whole.states is states


def test_a_function_of_each_state_is_the_same(states: Tensor) -> None:
    def function(part: Tensor) -> Tensor:
        return part.flatten(2)[..., :3] ** 2

    assert torch.equal(each_state(function, stored(states)), function(states))
    nothing = part(stored(states), slice(5, 5))
    assert each_state(function, nothing).shape == (0, 11, 3)


def test_parts_segments_and_joined_members_are_those_of_the_tensor(states: Tensor) -> None:
    def same(found: object, expected: Tensor) -> bool:
        assert isinstance(found, StoredStates)
        return found.shape == expected.shape and torch.equal(found[:, :], expected)

    kept = stored(states)
    assert same(part(kept, slice(-2, None)), states[-2:])
    segments = cut(states, 4)
    assert isinstance(segments, Tensor) and same(cut(kept, 4), segments)
    assert same(part(cut(kept, 4), slice(1, 8)), segments[1:8])
    other = StoredStates(TensorReader(states + 1), [3, 0])
    order = [5, 0, 6, 2]
    joined = StoredStates(JoinedReader([kept, other]), order)
    assert same(joined, torch.cat([states, states[[3, 0]] + 1])[order])


def test_thinned_states_and_the_rms_are_those_of_the_tensor(states: Tensor) -> None:
    for count in (4, 10, 999):
        assert torch.equal(thinned(stored(states), count), thinned(states, count))
        assert len(thinned(states, count)) >= min(count, 55)
    expected = states.square().mean(dim=(0, 1, 3)).sqrt()
    torch.testing.assert_close(rms_of_fields(stored(states)), expected)
    torch.testing.assert_close(rms_of_fields(states), expected)
