"""Open the program of a system."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from dashred.core.errors import InputError
from dashred.physics.external.function import FunctionProgram, run_as_step
from dashred.physics.external.partial import PartialProgram
from dashred.physics.external.protocol import Program
from dashred.physics.external.stepped_fields import stepped_fields
from dashred.physics.external.trust import check_trusted
from dashred.physics.external.user_code import last_words, load
from dashred.physics.system_schema import System


def open_program(config: System, where: Callable[[str], str]) -> Program:
    """Return the program of a system; a process opens each program once.

    Args:
        config: of the system, with ``simulator``.
        where: location of a configuration key.

    Raises:
        InputError: the program is not trusted, or cannot be opened.
    """
    simulator = config.simulator
    assert simulator is not None
    key = "function" if simulator.function is not None else "run"
    name = simulator.function or simulator.run
    assert name is not None
    place = where(f"system.simulator.{key}")
    check_trusted(name, place)
    own = stepped_fields(config)
    program = _open_function(name, key == "run", own, place)
    places = [i for i, field in enumerate(config.fields) if field in own]
    return program if len(places) == len(config.fields) else PartialProgram(program, places)


@lru_cache
def _open_function(name: str, runs: bool, fields: tuple[str, ...], place: str) -> Program:
    try:
        function = load(name)
    except Exception as error:  # user code may raise any exception
        hint = "its module must be in the current folder, or installed"
        what = f"{name} cannot be imported: {last_words(error)}"
        raise InputError(what, where=place, hint=hint) from error
    if not callable(function):
        raise InputError(f"{name} is not a function", where=place)
    step = run_as_step(function, fields) if runs else function
    return FunctionProgram(step, fields, name, place)
