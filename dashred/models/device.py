"""Check of the device on which networks are trained and spectral fields are integrated."""

from __future__ import annotations

import torch

from dashred.config import Config
from dashred.core.errors import InputError


def check_device(config: Config) -> None:
    """Check that the configured device exists.

    Raises:
        InputError: this machine has no such device.
    """
    kind, _, index = config.device.partition(":")
    if kind == "cuda" and int(index or 0) >= torch.cuda.device_count():
        raise InputError(
            f"this machine has {torch.cuda.device_count()} CUDA devices, not {config.device!r}",
            where=config.where("device"),
            hint="choose device=cpu",
        )
