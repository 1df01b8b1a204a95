"""How long a trained network takes for one assimilation step: from a window to the whole field."""

from __future__ import annotations

import time
from statistics import median

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.models.shred import SHRED

# Steps whose median counts, after some that warm up.
TIMED, WARM = 200, 20


@torch.no_grad()
def seconds_a_step(shred: SHRED, window: Float[Tensor, "lag sensor"]) -> float:
    """Return the median seconds of one step, as it comes in: a single window at a time.

    Args:
        shred: the network, on the CPU.
        window: of readings, in the sensors' own units.
    """
    taken = []
    for _ in range(WARM + TIMED):
        began = time.perf_counter()
        shred(window[None])
        taken.append(time.perf_counter() - began)
    return median(taken[WARM:])
