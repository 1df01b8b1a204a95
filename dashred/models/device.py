"""Check of the devices on which networks are trained and spectral fields are integrated."""

from __future__ import annotations

import os
import sys
from multiprocessing import current_process

import torch

from dashred.config import Config
from dashred.config.network_devices import accelerator, process_count
from dashred.core.errors import InputError


def check_device(config: Config) -> None:
    """Check that the configured devices exist, and that processes can be started for them.

    Raises:
        InputError: this machine has no such device, or other processes cannot start.
    """
    kind, _, index = config.device.partition(":")
    if kind == "cuda" and int(index or 0) >= torch.cuda.device_count():
        raise InputError(
            f"this machine has {torch.cuda.device_count()} CUDA devices, not {config.device!r}",
            where=config.where("device"),
            hint="choose device=cpu",
        )
    _check_count(config)
    _check_precision(config)
    if process_count(config) is not None:
        _check_start(config)


def _check_count(config: Config) -> None:
    """Check the number of devices of the networks."""
    on_gpu = accelerator(config) == "gpu"
    count = torch.cuda.device_count() if on_gpu else os.cpu_count() or 1
    needed = config.trainer.devices or 1
    if needed > count:
        raise InputError(
            f"this machine has {count} {'CUDA devices' if on_gpu else 'CPUs'}, but the networks "
            f"need {needed}",
            where=config.where("trainer.accelerator" if count == 0 else "trainer.devices"),
            hint="choose trainer.accelerator=cpu" if count == 0 else f"at most {count}",
        )


def _check_precision(config: Config) -> None:
    """Check that the networks can be trained in the configured precision."""
    precision = config.trainer.precision
    if precision == "bf16-mixed" and accelerator(config) == "cpu" and not trains_in_bfloat16():
        raise InputError(
            "this processor cannot train the networks in bfloat16",
            where=config.where("trainer.precision"),
            hint="choose trainer.precision=null",
        )


def trains_in_bfloat16() -> bool:
    """Return whether the CPU has an LSTM in bfloat16; it needs AVX-512."""
    lstm = torch.nn.LSTM(1, 1, batch_first=True)
    try:
        with torch.autocast("cpu", dtype=torch.bfloat16):
            lstm(torch.zeros(1, 1, 1))
    except RuntimeError:
        return False
    return True


def _check_start(config: Config) -> None:
    """Check that a process that imports the main module does not start the analysis again."""
    where = config.where("trainer.devices")
    if hasattr(sys, "ps1"):
        raise InputError(
            "networks cannot be trained in other processes from a notebook or an interactive shell",
            where=where,
            hint="run a script or the command line, or choose trainer.devices=null",
        )
    # Python sets this mark in a new process while it imports the script.
    if getattr(current_process(), "_inheriting", False):
        raise InputError(
            "each process that trains the networks would start the analysis again",
            where=where,
            hint='put the analysis of the script under: if __name__ == "__main__":',
        )
