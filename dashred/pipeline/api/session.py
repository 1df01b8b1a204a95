"""Process-wide settings of the stages, restored afterwards."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import threadpool_limits

from dashred.config import Config
from dashred.pipeline.run.analysis_cluster import analysis_cluster
from dashred.pipeline.run.provenance import prepare_torch

LIGHTNING = "lightning.pytorch"


@contextmanager
def session(config: Config) -> Iterator[None]:
    """Apply the settings of a run: number of threads, determinism, random numbers and log level.

    Raises:
        InputError: this machine does not have the configured device, or the configured cluster
            does not answer.
    """
    # Imported here because the import takes seconds.
    from lightning.pytorch.utilities.seed import isolate_rng

    threads, logger = torch.get_num_threads(), logging.getLogger(LIGHTNING)
    level, strict = logger.level, torch.are_deterministic_algorithms_enabled()
    warn_only = torch.is_deterministic_algorithms_warn_only_enabled()
    with warnings.catch_warnings(), isolate_rng(), threadpool_limits(1):
        try:
            prepare_torch(config)
            with analysis_cluster(config):
                yield
        finally:
            torch.set_num_threads(threads)
            torch.use_deterministic_algorithms(strict, warn_only=warn_only)
            logger.setLevel(level)
