"""Data loaders that index whole batches of tensors at once instead of single samples."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.utils.data import (
    BatchSampler,
    DataLoader,
    RandomSampler,
    SequentialSampler,
    TensorDataset,
)

Batches = DataLoader[tuple[Tensor, ...]]


def shuffled_batches(tensors: tuple[Tensor, ...], size: int, seed: int) -> Batches:
    """Return a loader of random batches whose order is fixed by ``seed``."""
    dataset = TensorDataset(*tensors)
    order = RandomSampler(dataset, generator=torch.Generator().manual_seed(seed))
    return _loader(dataset, BatchSampler(order, size, drop_last=False))


def ordered_batches(tensors: tuple[Tensor, ...], size: int) -> Batches:
    """Return a loader of consecutive batches."""
    dataset = TensorDataset(*tensors)
    return _loader(dataset, BatchSampler(SequentialSampler(dataset), size, drop_last=False))


def _loader(dataset: TensorDataset, batches: BatchSampler) -> Batches:
    return DataLoader(dataset, sampler=batches, batch_size=None)
