"""Several processes share each batch: together they have every sample once."""

from __future__ import annotations

from itertools import chain

import pytest
import torch

from datamodules.batches import Share, ordered_batches, shuffled_batches

SAMPLES = torch.arange(21)


def numbers(batches) -> list[list[int]]:
    return [batch[0].tolist() for batch in batches]


@pytest.mark.parametrize("count", [2, 3])
def test_the_shares_of_a_batch_are_the_batch(count: int) -> None:
    whole = numbers(shuffled_batches((SAMPLES,), 8, 5))
    shares = [numbers(shuffled_batches((SAMPLES,), 8, 5, Share(r, count))) for r in range(count)]
    for batch, *parts in zip(whole, *shares, strict=True):
        assert sorted(chain.from_iterable(parts)) == sorted(batch)
        assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_the_order_differs_from_epoch_to_epoch_but_not_between_processes() -> None:
    loaders = [shuffled_batches((SAMPLES,), 21, 5, Share(rank, 2)) for rank in range(2)]
    epochs = [[numbers(loader)[0] for loader in loaders] for _ in range(2)]
    assert all(set(first) | set(second) == set(range(21)) for first, second in epochs)
    assert epochs[0] != epochs[1]


def test_a_small_last_batch_is_joined_to_the_one_before() -> None:
    shares = [numbers(ordered_batches((SAMPLES,), 10, Share(rank, 2))) for rank in range(2)]
    assert [len(share) for share in shares] == [2, 2]
    assert shares[0][-1] == [10, 12, 14, 16, 18, 20]
    assert numbers(ordered_batches((SAMPLES,), 10))[-1] == [20]  # one process alone computes it


def test_fewer_samples_than_processes_are_refused() -> None:
    with pytest.raises(ValueError, match="21 samples cannot be shared among 22 processes"):
        ordered_batches((SAMPLES,), 30, Share(0, 22))
