"""Data loaders that index whole batches of tensors at once instead of single samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from lightning import Trainer
from torch import Tensor
from torch.utils.data import (
    BatchSampler,
    DataLoader,
    RandomSampler,
    Sampler,
    SequentialSampler,
    TensorDataset,
)

Batches = DataLoader[tuple[Tensor, ...]]


@dataclass(frozen=True)
class Share:
    """The part of each batch that one of several processes computes.

    Attributes:
        rank: number of the process, from 0.
        count: number of processes.
    """

    rank: int = 0
    count: int = 1

    @classmethod
    def of(cls, trainer: Trainer | None) -> Share:
        """Return the share of the process in which a trainer runs; all of it without a trainer."""
        return WHOLE if trainer is None else cls(trainer.global_rank, trainer.world_size)


WHOLE = Share()


class SharedBatches(Sampler[list[int]]):
    """Every ``count``-th sample of each batch, so that the batch of all processes has its size.

    All processes have the same number of batches. A last batch with fewer samples than processes
    gives its first sample to those that would have none.
    """

    def __init__(self, batches: BatchSampler, share: Share) -> None:
        self.batches, self.share = batches, share

    def __iter__(self) -> Iterator[list[int]]:
        """Yield the indices of the samples, batch by batch."""
        for batch in self.batches:
            yield batch[self.share.rank :: self.share.count] or batch[:1]

    def __len__(self) -> int:
        """Return the number of batches."""
        return len(self.batches)


def shuffled_batches(
    tensors: tuple[Tensor, ...], size: int, seed: int, share: Share = WHOLE
) -> Batches:
    """Return a loader of a share in random batches whose order is fixed by ``seed``."""
    dataset = TensorDataset(*tensors)
    order = RandomSampler(dataset, generator=torch.Generator().manual_seed(seed))
    return _loader(dataset, order, size, share)


def ordered_batches(tensors: tuple[Tensor, ...], size: int, share: Share = WHOLE) -> Batches:
    """Return a loader of a share in consecutive batches."""
    dataset = TensorDataset(*tensors)
    return _loader(dataset, SequentialSampler(dataset), size, share)


def _loader(dataset: TensorDataset, order: Sampler[int], size: int, share: Share) -> Batches:
    batches = SharedBatches(BatchSampler(order, size, drop_last=False), share)
    return DataLoader(dataset, sampler=batches, batch_size=None)
