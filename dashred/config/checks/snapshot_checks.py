"""Checks of a system given as snapshots: keys that need equations are refused."""

from __future__ import annotations

from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where
from dashred.core.errors import InputError
from dashred.physics.system_schema import System

# Keys of a system that need equations.
EQUATION_KEYS = (
    "equations",
    "parameter_spread",
    "parameter_per",
    "start",
    "spin_up",
    "spin_up_dt",
    "spread",
    "energy",
    "structure",
    "inputs",
)


def check_snapshots(settings: Settings, where: Where) -> None:
    """Refuse keys that have no meaning for a system given as snapshots.

    Raises:
        InputError: such a key is set, or the recording is a twin, whose truth needs equations.
    """
    system = settings.system
    if system.snapshots is None:
        return
    if settings.recording.calibration is not None:
        raise InputError(
            "recording.calibration and system.snapshots are both given",
            where=where("recording.calibration"),
            hint="a calibration is fitted through equations: correct the readings before the run",
        )
    if unused := next((key for key in EQUATION_KEYS if getattr(system, key)), None):
        value = getattr(system, unused)
        first = f".{next(iter(value))}" if isinstance(value, dict) else ""
        raise InputError(
            f"system.{unused} and system.snapshots are both given",
            where=where(f"system.{unused}{first}"),
            hint=_advice(system),
        )
    for key in ("method", "dt"):
        if getattr(system.integrator, key) is not None:
            raise InputError(
                f"system.integrator.{key} needs equations, but this system has snapshots",
                where=where(f"system.integrator.{key}"),
                hint="remove it",
            )
    if settings.recording.twin is not None:
        raise InputError(
            "a twin needs equations, but this system has snapshots",
            where=where("recording.twin"),
            hint="give your own recording with recording.path=FILE",
        )


def _advice(system: System) -> str:
    if system.equations:
        return "keep one of them, preferably the equations: only with them can laws be tested"
    return "remove it: it needs equations, and snapshots have none"
