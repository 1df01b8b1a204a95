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

    All processes have the same number of batches, and a sample in each: a last batch with fewer
    samples than processes is joined to the one before.

    Args:
        order: order of the samples.
        samples: their number.
        size: of a batch of all processes.
        share: of this process.
    """

    def __init__(self, order: Sampler[int], samples: int, size: int, share: Share) -> None:
        if samples < share.count:
            raise ValueError(f"{samples} samples cannot be shared among {share.count} processes")
        self.batches, self.share = BatchSampler(order, size, drop_last=False), share
        self.joins = 0 < samples % size < share.count

    def __iter__(self) -> Iterator[list[int]]:
        """Yield the indices of the samples, batch by batch."""
        batches = iter(self.batches)
        for number, batch in enumerate(batches, start=1):
            joined = batch + next(batches) if self.joins and number == len(self) else batch
            yield joined[self.share.rank :: self.share.count]

    def __len__(self) -> int:
        """Return the number of batches."""
        return len(self.batches) - self.joins


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
    batches = SharedBatches(order, len(dataset), size, share)
    return DataLoader(dataset, sampler=batches, batch_size=None)
