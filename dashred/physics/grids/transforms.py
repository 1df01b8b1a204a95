"""Fourier transforms over the axes of a grid, of NumPy arrays and of tensors.

All of them are counted (:mod:`dashred.core.work`), a complex one as two real ones.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import fft
from torch import Tensor

from dashred.core.work import count_transforms

# For smaller arrays SciPy's transform has less overhead; for larger ones torch's is faster.
MIN_TORCH_SIZE = 3000


def to_modes(points: NDArray[np.float64], rank: int) -> NDArray[np.complex128]:
    """Return the modes ``(…, *modes)`` of ``(…, *grid)`` with ``rank`` axes."""
    found: Any
    _count(points.size, points.shape[-rank:])
    if points.size >= MIN_TORCH_SIZE:
        dims = tuple(range(-rank, 0))
        found = torch.fft.rfftn(torch.from_numpy(points), dim=dims).numpy()
    elif rank == 1:
        found = fft.rfft(points)
    else:
        found = fft.rfftn(points, axes=tuple(range(-rank, 0)))
    return found


def from_modes(modes: NDArray[np.complex128], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return ``(…, *grid)`` of modes on a grid of that shape."""
    found: Any
    if 2 * modes.size >= MIN_TORCH_SIZE:
        dims = tuple(range(-len(shape), 0))
        found = torch.fft.irfftn(torch.from_numpy(modes), s=shape, dim=dims).numpy()
    elif len(shape) == 1:
        found = fft.irfft(modes, shape[0])
    else:
        found = fft.irfftn(modes, s=shape, axes=tuple(range(-len(shape), 0)))
    _count(found.size, shape)
    return found


def to_full_modes(points: NDArray[Any], rank: int) -> NDArray[Any]:
    """Return all modes ``(…, *grid)`` of complex values ``(…, *grid)`` with ``rank`` axes."""
    _count(2 * points.size, points.shape[-rank:])
    found = torch.fft.fftn(torch.from_numpy(points), dim=tuple(range(-rank, 0)))
    return found.numpy()


def modes_of(points: Tensor, shape: tuple[int, ...]) -> Tensor:
    """Return the modes ``(…, *modes)`` of a tensor on a grid of that shape, on its device."""
    _count(points.numel(), shape)
    return torch.fft.rfftn(points, dim=tuple(range(-len(shape), 0)))


def points_of(modes: Tensor, shape: tuple[int, ...]) -> Tensor:
    """Return the tensor ``(…, *grid)`` of modes on a grid of that shape, on its device."""
    found = torch.fft.irfftn(modes, s=shape, dim=tuple(range(-len(shape), 0)))
    _count(found.numel(), shape)
    return found


def _count(values: int, shape: tuple[int, ...]) -> None:
    points = math.prod(shape)
    count_transforms(values // points, points)
