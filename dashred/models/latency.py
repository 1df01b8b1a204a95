"""Latency of one assimilation step: from a window to the full field."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.models.shred import SHRED

# Number of timed steps, after a number of warm-up steps.
TIMED_STEPS, WARM_UP_STEPS = 200, 20


@torch.no_grad()
def seconds_per_step(shred: SHRED, window: Float[Tensor, "lag sensor"]) -> float:
    """Return the median duration in seconds of one step, for a single window on one core.

    Args:
        shred: the network, on the CPU.
        window: of sensor values, in the sensors' own units.
    """
    taken = []
    with _one_thread():
        for _ in range(WARM_UP_STEPS + TIMED_STEPS):
            began = time.perf_counter()
            shred(window[None])
            taken.append(time.perf_counter() - began)
    return median(taken[WARM_UP_STEPS:])


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit torch to one thread: for so little work, a second one costs more than it saves."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
