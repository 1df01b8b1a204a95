"""A system that is given as snapshots: which keys mean something for it, and which do not."""

from __future__ import annotations

from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where
from dashred.core.errors import InputError
from dashred.physics.system_schema import System

# What is said with equations, of equations.
OF_EQUATIONS = (
    "equations",
    "start",
    "spin_up",
    "spin_up_dt",
    "spread",
    "energy",
    "structure",
    "inputs",
)


def check_snapshots(settings: Settings, where: Where) -> None:
    """Refuse keys that nothing would read where snapshots stand for the equations.

    Raises:
        InputError: such a key, a twin (its truth is made with equations), or too few members.
    """
    system = settings.system
    if system.snapshots is None:
        return
    if idle := next((key for key in OF_EQUATIONS if getattr(system, key)), None):
        value = getattr(system, idle)
        first = f".{next(iter(value))}" if isinstance(value, dict) else ""
        raise InputError(
            f"system.{idle} and system.snapshots are both given",
            where=where(f"system.{idle}{first}"),
            hint=_advice(system),
        )
    for key in ("method", "dt"):
        if getattr(system.integrator, key) is not None:
            raise InputError(
                f"system.integrator.{key} steps equations, but this system has snapshots",
                where=where(f"system.integrator.{key}"),
                hint="leave it out",
            )
    if settings.recording.twin is not None:
        raise InputError(
            "a twin's truth is made with equations, but this system has snapshots",
            where=where("recording.twin"),
            hint="give recording.path=FILE, a recording of yours",
        )


def _advice(system: System) -> str:
    if system.equations:
        return "keep one: equations are the better choice, as laws can be tested with them alone"
    return "leave it out: it is said of equations, and snapshots have none"
