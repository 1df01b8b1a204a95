"""Checks of the section ``trainer`` against itself and the rest of a configuration."""

from __future__ import annotations

import re

from dashred.config.network_devices import accelerator, process_count
from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where
from dashred.core.errors import InputError

STRATEGY = "ddp_spawn"
# Strategies of Lightning that run the command again for each device.
RERUNNING = re.compile(r"ddp(_find_unused_parameters_\w+)?|(fsdp|deepspeed)\w*")
FORKING = re.compile(r"ddp_(fork|notebook)\w*")


def check_trainer(settings: Settings, where: Where) -> None:
    """Check devices, strategy and precision of the networks.

    Raises:
        InputError: a value contradicts another, or the strategy cannot be used here.
    """
    _check_strategy(settings.trainer.strategy, where("trainer.strategy"))
    _check_devices(settings, where)
    if settings.trainer.precision == "16-mixed" and accelerator(settings) == "cpu":
        raise InputError(
            "trainer.precision=16-mixed needs a GPU, and the networks are trained on the CPU",
            where=where("trainer.precision"),
            hint="choose bf16-mixed, or null for 32-true",
        )


def _check_strategy(strategy: str | None, where: str) -> None:
    if strategy is None or strategy == STRATEGY:
        return
    if FORKING.fullmatch(strategy):
        problem = f"{strategy} copies a running analysis, whose threads and GPUs cannot be copied"
    elif RERUNNING.fullmatch(strategy):
        problem = f"{strategy} starts the whole analysis once for each device"
    else:
        problem = f"unknown strategy {strategy!r}"
    raise InputError(problem, where=where, hint=f"choose {STRATEGY}, or null")


def _check_devices(settings: Settings, where: Where) -> None:
    if settings.device.startswith("cuda") and accelerator(settings) == "cpu":
        raise InputError(
            f"device={settings.device} and trainer.accelerator=cpu contradict each other",
            where=where("trainer.accelerator"),
            hint="choose trainer.accelerator=null, or device=cpu",
        )
    count = process_count(settings)
    if count is None:
        return
    if settings.device.startswith("cuda:"):
        raise InputError(
            f"device={settings.device} names one GPU, but other processes take the first {count}",
            where=where("trainer.devices"),
            hint="choose device=cuda, or trainer.devices=null and trainer.strategy=null",
        )
    for section, batch in {
        "shred": settings.shred.batch,
        "assimilation": settings.assimilation.batch,
    }.items():
        if batch < count:
            raise InputError(
                f"{section}.batch={batch} cannot be shared among {count} devices",
                where=where("trainer.devices"),
                hint=f"choose at most {batch} devices, or a larger {section}.batch",
            )
