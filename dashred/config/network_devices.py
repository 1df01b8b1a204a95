"""What the keys ``device`` and ``trainer`` say together about the devices of the networks."""

from __future__ import annotations

from dashred.config.schema.settings import Settings


def accelerator(settings: Settings) -> str:
    """Return Lightning's name of the kind of device of the networks: ``cpu`` or ``gpu``."""
    chosen = settings.trainer.accelerator
    return chosen or ("gpu" if settings.device.startswith("cuda") else "cpu")


def process_count(settings: Settings) -> int | None:
    """Return how many other processes train the networks; None for the process of the analysis."""
    devices = settings.trainer.devices or 1
    return None if devices == 1 and settings.trainer.strategy is None else devices
