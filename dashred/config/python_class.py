"""A simulator in Python: whose code may run is said on the command line, and nowhere else."""

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

KEY = "system.class"
DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+\Z")
# What knows the truth of twins is among these; a user's simulator is not.
OWN = ("dashred", "callbacks", "datamodules")


def take_trust(words: list[str]) -> tuple[list[str], str | None]:
    """Split ``trust=MODULE.CLASS`` off a command line's words.

    Raises:
        InputError: it is given twice.
    """
    trusted = [word.removeprefix("trust=") for word in words if word.startswith("trust=")]
    if len(trusted) > 1:
        raise InputError("trust= is given twice", where="command line")
    rest = [word for word in words if not word.startswith("trust=")]
    return rest, trusted[0] if trusted else None


def check_trust(settings: Settings, trusted: str | None, where: Where) -> None:
    """Refuse to run a class that the command line does not name, before any of it is imported.

    Raises:
        InputError: it is not trusted, or is no class of the user's; or what is trusted is not used.
    """
    system = settings.system
    name = system.class_
    if name is None:
        if trusted is not None:
            what = f"trust={trusted} is given, but the system names no class"
            raise InputError(what, where="command line", hint="leave it out")
        return
    if not DOTTED.match(name):
        hint = "write MODULE.CLASS, such as mypkg.MySystem"
        raise InputError(f"{name!r} is not the name of a class", where=where(KEY), hint=hint)
    if name.partition(".")[0] in OWN:
        raise InputError(f"{name} is no simulator of yours", where=where(KEY))
    if trusted != name:
        raise InputError(
            f"this system runs the code of {name}, which can do anything that you can",
            where=where(KEY),
            hint=f"read it first; if you trust it, add trust={name} to the command line",
        )
    for key in ("equations", "snapshots"):
        if getattr(system, key):
            what = f"{KEY} and system.{key} are both given"
            raise InputError(what, where=where(KEY), hint="keep one of them")
    if settings.recording.twin is not None:
        what = "a twin's truth is made of declared equations, but this system has a class"
        hint = "give recording.path=FILE, a recording of yours"
        raise InputError(what, where=where("recording.twin"), hint=hint)


def with_equations(settings: Settings, where: Where) -> System:
    """Return the system with the equations that its trusted class computes.

    Raises:
        InputError: the class cannot be imported, fails, or does what no equation says.
    """
    # Imported late: torch takes seconds, and few systems have a class.
    from dashred.physics import system as physics
    from dashred.physics.external.tracing import equations_differ, trace
    from dashred.physics.external.tracing_values import NotTraceableError

    system, place = settings.system, where(KEY)
    simulator = _made(str(system.class_), place)
    try:
        equations = trace(simulator, physics.System(system, where))
        found = replace(system, equations=equations)
        differs = equations_differ(simulator, physics.System(found, where))
    except (NotTraceableError, InputError) as error:
        what = f"{system.class_} does what the equation language does not have: {error}"
        raise InputError(what, where=place, hint=_other_way()) from None
    except Exception as error:  # a stranger's code fails in any way
        raise _failed(str(system.class_), error, place) from error
    if differs is not None:
        what = f"with numbers, {system.class_} gives another tendency of {differs} than with names"
        raise InputError(what, where=place, hint=_other_way())
    return found


def _other_way() -> str:
    return "give snapshots of its runs (system.snapshots), with which all but refinement works"


def _made(name: str, place: str) -> Any:
    module, _, attribute = name.rpartition(".")
    here = str(Path.cwd())
    if here not in sys.path:
        # Last: of what else lies there, nothing is asked for by name.
        sys.path.append(here)
    try:
        simulator = getattr(import_module(module), attribute)()
    except Exception as error:  # a stranger's code fails in any way
        raise _failed(name, error, place) from error
    if not callable(getattr(simulator, "tendency", None)):
        hint = "see docs/black-box.md"
        raise InputError(f"{name} has no method tendency", where=place, hint=hint)
    return simulator


def _failed(name: str, error: Exception, place: str) -> InputError:
    last = traceback.extract_tb(error.__traceback__)[-1]
    what = f"{name} fails: {type(error).__name__}: {error} ({last.filename}:{last.lineno})"
    hint = "its module has to lie in the folder you are in, or be installed"
    return InputError(what, where=place, hint=hint if isinstance(error, ImportError) else None)
