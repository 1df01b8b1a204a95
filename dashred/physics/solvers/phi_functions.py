"""The φ functions of exponential integrators, without cancellation.

``φ_0 = exp z`` and ``φ_{k+1}(z) = (φ_k(z) − φ_k(0))/z`` with ``φ_k(0) = 1/k!``. For small z the
recurrence loses digits: there the last function is a Taylor series, and ``φ_k = 1/k! + z φ_{k+1}``
gives the others.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

# Below this size of z the series is used. The recurrence loses less than two digits above it.
SMALL = 1.0
# The first term that is left out is less than 1/18! times the first one.
TERMS = 17


def phi_functions(z: Tensor, count: int) -> list[Tensor]:
    """Return φ_0 … φ_count.

    Args:
        z: real or complex values of any shape.
        count: index of the last function, at least 1.
    """
    is_small = z.abs() < SMALL
    # Neither formula sees the values of the other, so that gradients are finite, too.
    near, far = torch.where(is_small, z, 0), torch.where(is_small, 1, z)
    series = _series(near, count)
    large = [torch.exp(far)]
    for k in range(count):
        large.append((large[k] - 1 / math.factorial(k)) / far)
    return [torch.where(is_small, *pair) for pair in zip(series, large, strict=True)]


def _series(z: Tensor, count: int) -> list[Tensor]:
    """Return φ_0 … φ_count for small z."""
    last = torch.full_like(z, 1 / math.factorial(TERMS + count))
    for j in reversed(range(TERMS)):
        last = last * z + 1 / math.factorial(j + count)
    found = [last]
    for k in reversed(range(count)):
        found.append(found[-1] * z + 1 / math.factorial(k))
    return found[::-1]
