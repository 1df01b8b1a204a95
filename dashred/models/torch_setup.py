"""Settings of torch and Lightning in a process that computes a run or a part of it."""

from __future__ import annotations

import logging
import warnings

import torch

from dashred.core.threads import compute_in_one_thread, use_threads


def set_up_torch(threads: int) -> None:
    """Set threads and determinism of this process.

    Args:
        threads: number of threads for trajectories.
    """
    use_threads(threads)
    # The arrays are too small for several threads: on a busy machine the threads of torch and of
    # NumPy's linear algebra would mostly wait for each other. Moreover, with several threads the
    # batched LU of matrices larger than 150 is wrong in torch 2.13 with MKL 2024.2: one of 200 was
    # off by 1e14 without an error, or the call hung.
    compute_in_one_thread()
    torch.use_deterministic_algorithms(True, warn_only=True)
    # Lightning prints tips and notes about GPUs that do not concern the user.
    logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)
    # Lightning uses a class that torch deprecates; the user cannot do anything about it.
    warnings.filterwarnings("ignore", message=".*LeafSpec.*", category=FutureWarning)
