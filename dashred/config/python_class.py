"""Simulators as Python classes, whose equations are traced."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where
from dashred.config.trust import CLASS_KEY
from dashred.core.errors import InputError
from dashred.physics.external.adapters.user_code import last_words, load
from dashred.physics.system_schema import System


def trace_class(settings: Settings, where: Where) -> System:
    """Return the system with the equations traced from its trusted class.

    Raises:
        InputError: the class cannot be imported, fails, or cannot be expressed as equations.
    """
    # Imported here, because torch takes seconds and few systems have a class.
    from dashred.physics import system as physics
    from dashred.physics.black_box.tracing import first_mismatch, trace
    from dashred.physics.black_box.tracing_values import NotTraceableError

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
    try:
        simulator = load(name, place)()
    except InputError:
        raise
    except Exception as error:  # user code may raise any exception
        raise _class_error(name, error, place) from error
    if not callable(getattr(simulator, "tendency", None)):
        hint = "see docs/black-box.md"
        raise InputError(f"{name} has no method tendency", where=place, hint=hint)
    return simulator


def _class_error(name: str, error: Exception, place: str) -> InputError:
    hint = "its module must be in the current folder, or installed"
    what = f"{name} fails: {last_words(error)}"
    return InputError(what, where=place, hint=hint if isinstance(error, ImportError) else None)
