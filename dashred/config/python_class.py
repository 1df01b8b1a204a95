"""Simulators as Python classes, which run only if the command line trusts them."""

from __future__ import annotations

import re
import sys
import traceback
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where
from dashred.core.errors import InputError
from dashred.physics.system_schema import System

CLASS_KEY = "system.class"
DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+\Z")
# These packages include the truth of twins and cannot be a user's simulator.
OWN_PACKAGES = ("dashred", "callbacks", "datamodules")


def split_trust(words: list[str]) -> tuple[list[str], str | None]:
    """Split ``trust=MODULE.CLASS`` off the command-line arguments.

    Returns:
        The other arguments, and the trusted class or None.

    Raises:
        InputError: it is given twice.
    """
    trusted = [word.removeprefix("trust=") for word in words if word.startswith("trust=")]
    if len(trusted) > 1:
        raise InputError("trust= is given twice", where="command line")
    rest = [word for word in words if not word.startswith("trust=")]
    return rest, trusted[0] if trusted else None


def check_trust(settings: Settings, trusted: str | None, where: Where) -> None:
    """Check, before any import, that the command line trusts the class of the system.

    Raises:
        InputError: the class is not trusted or belongs to dashred, or the system has no class.
    """
    system = settings.system
    name = system.class_
    if name is None:
        if trusted is not None:
            what = f"trust={trusted} is given, but the system names no class"
            raise InputError(what, where="command line", hint="remove it")
        return
    if not DOTTED.match(name):
        hint = "write MODULE.CLASS, such as mypkg.MySystem"
        raise InputError(f"{name!r} is not the name of a class", where=where(CLASS_KEY), hint=hint)
    if name.partition(".")[0] in OWN_PACKAGES:
        raise InputError(f"{name} is not a user's simulator", where=where(CLASS_KEY))
    if trusted != name:
        raise InputError(
            f"this system runs the code of {name}, with all your permissions",
            where=where(CLASS_KEY),
            hint=f"read it first; if you trust it, add trust={name} to the command line",
        )
    for key in ("equations", "snapshots"):
        if getattr(system, key):
            what = f"{CLASS_KEY} and system.{key} are both given"
            raise InputError(what, where=where(CLASS_KEY), hint="keep one of them")
    if settings.recording.twin is not None:
        what = "a twin needs declared equations, but this system has a class"
        hint = "give your own recording with recording.path=FILE"
        raise InputError(what, where=where("recording.twin"), hint=hint)


def trace_class(settings: Settings, where: Where) -> System:
    """Return the system with the equations traced from its trusted class.

    Raises:
        InputError: the class cannot be imported, fails, or cannot be expressed as equations.
    """
    # Imported here, because torch takes seconds and few systems have a class.
    from dashred.physics import system as physics
    from dashred.physics.external.tracing import first_mismatch, trace
    from dashred.physics.external.tracing_values import NotTraceableError

    system, place = settings.system, where(CLASS_KEY)
    simulator = _instantiate(str(system.class_), place)
    try:
        equations = trace(simulator, physics.System(system, where))
        found = replace(system, equations=equations)
        differs = first_mismatch(simulator, physics.System(found, where))
    except (NotTraceableError, InputError) as error:
        what = f"{system.class_} cannot be expressed in the equation language: {error}"
        raise InputError(what, where=place, hint=_snapshot_hint()) from None
    except Exception as error:  # user code may raise any exception
        raise _class_error(str(system.class_), error, place) from error
    if differs is not None:
        what = f"the traced equations of {system.class_} give another tendency of {differs}"
        raise InputError(what, where=place, hint=_snapshot_hint())
    return found


def _snapshot_hint() -> str:
    return "give snapshots of its runs (system.snapshots); all but refinement works with them"


def _instantiate(name: str, place: str) -> Any:
    module, _, attribute = name.rpartition(".")
    here = str(Path.cwd())
    if here not in sys.path:
        # Last, so that other files in this folder do not hide installed modules.
        sys.path.append(here)
    try:
        simulator = getattr(import_module(module), attribute)()
    except Exception as error:  # user code may raise any exception
        raise _class_error(name, error, place) from error
    if not callable(getattr(simulator, "tendency", None)):
        hint = "see docs/black-box.md"
        raise InputError(f"{name} has no method tendency", where=place, hint=hint)
    return simulator


def _class_error(name: str, error: Exception, place: str) -> InputError:
    last = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{name} fails: {type(error).__name__}: {error} ({last.filename}:{last.lineno})"
    hint = "its module must be in the current folder, or installed"
    return InputError(what, where=place, hint=hint if isinstance(error, ImportError) else None)
