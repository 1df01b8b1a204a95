"""How long a trained network takes for one assimilation step: from a window to the whole field."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.models.shred import SHRED

# Steps whose median counts, after some that warm up.
TIMED, WARM = 200, 20


@torch.no_grad()
def seconds_a_step(shred: SHRED, window: Float[Tensor, "lag sensor"]) -> float:
    """Return the median seconds of one step on one core, as it comes in: a single window at a time.

    Args:
        shred: the network, on the CPU.
        window: of readings, in the sensors' own units.
    """
    taken = []
    with _one_core():
        for _ in range(WARM + TIMED):
            began = time.perf_counter()
            shred(window[None])
            taken.append(time.perf_counter() - began)
    return median(taken[WARM:])


@contextmanager
def _one_core() -> Iterator[None]:
    """Keep torch to one thread: of so little work a second one would take more than it gives."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
