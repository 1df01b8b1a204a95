"""Code of others, which runs only if the command line trusts it."""

from __future__ import annotations

import re
from pathlib import Path

from dashred.config.layers import absolute_path
from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where
from dashred.core.command_line.arguments import COMMAND_LINE
from dashred.core.errors import InputError
from dashred.physics.external.trust import names_of, not_trusted, trust
from dashred.physics.system_schema import System

CLASS_KEY, SIMULATOR_KEY = "system.class", "system.simulator"
DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+\Z")
EXAMPLE = 'for example [./solver, --in, "{input}", --out, "{output}"]'
# These packages include the truth of twins and cannot be a user's simulator.
OWN_PACKAGES = ("dashred", "callbacks", "datamodules")


def split_trust(words: list[str]) -> tuple[list[str], str | None]:
    """Split ``trust=NAME`` off the command-line arguments.

    Returns:
        The other arguments, and the trusted name or None.

    Raises:
        InputError: it is given twice.
    """
    trusted = [word.removeprefix("trust=") for word in words if word.startswith("trust=")]
    if len(trusted) > 1:
        raise InputError("trust= is given twice", where=COMMAND_LINE)
    rest = [word for word in words if not word.startswith("trust=")]
    return rest, trusted[0] if trusted else None


def check_trust(settings: Settings, trusted: str | None, where: Where, folder: Path) -> None:
    """Check, before any import, that the user trusts the code that a system runs.

    Args:
        settings: with the system.
        trusted: the name after ``trust=``.
        where: location of a configuration key.
        folder: of the system's file, to which its paths are relative.

    Raises:
        InputError: the code is not trusted or belongs to dashred, or the system runs no code.
    """
    system = settings.system
    key, name = _code(system, where)
    if name is None:
        if trusted is not None:
            what = f"trust={trusted} is given, but the system names no class and no simulator"
            raise InputError(what, where=COMMAND_LINE, hint="remove it")
        return
    if key.rpartition(".")[2] in ("class", "function", "run"):
        _check_name(name, where(key))
        is_trusted = trusted == name
    else:
        is_trusted = trusted is not None and _is_file(trusted, name, folder)
    if not is_trusted:
        simulator = system.simulator
        words = (simulator and simulator.command) or ()
        raise not_trusted(name, where(key), words)
    _check_alone(settings, key, where)
    trust(name)


def _code(system: System, where: Where) -> tuple[str, str | None]:
    """Return the key of the code that a system runs, and its name."""
    simulator = system.simulator
    given = [] if system.class_ is None else [(CLASS_KEY, system.class_)]
    if simulator is not None:
        if simulator.command == []:
            key = f"{SIMULATOR_KEY}.command"
            raise InputError(f"{key} has no words", where=where(key), hint=EXAMPLE)
        given += [(f"{SIMULATOR_KEY}.{key}", name) for key, name in names_of(simulator).items()]
    if len(given) > 1:
        what = f"{given[0][0]} and {given[1][0]} are both given"
        raise InputError(what, where=where(given[1][0]), hint="keep one of them")
    if simulator is not None and not given:
        hint = "set one of function, run, command and fmu"
        raise InputError(f"{SIMULATOR_KEY} names no program", where=where(SIMULATOR_KEY), hint=hint)
    return given[0] if given else (CLASS_KEY, None)


def _check_name(name: str, place: str) -> None:
    if not DOTTED.match(name):
        hint = "write MODULE.NAME, such as mypkg.step"
        raise InputError(f"{name!r} is not a name in a module", where=place, hint=hint)
    if name.partition(".")[0] in OWN_PACKAGES:
        raise InputError(f"{name} is not a user's simulator", where=place)


def _is_file(trusted: str, name: str, folder: Path) -> bool:
    """Whether the trusted word is a program, from the system's folder or the current folder."""
    folders = (folder, Path.cwd())
    paths = [absolute_path(trusted, folder=each, where=COMMAND_LINE) for each in folders]
    return name in (trusted, *paths)


def _check_alone(settings: Settings, key: str, where: Where) -> None:
    """Check that nothing is given that does not go with code."""
    # A class is its equations; a simulator may have more beside it.
    for other in ("equations", "snapshots") if key == CLASS_KEY else ("snapshots",):
        if getattr(settings.system, other):
            what = f"{key} and system.{other} are both given"
            raise InputError(what, where=where(key), hint="keep one of them")
    if settings.recording.twin is not None:
        kind = "class" if key == CLASS_KEY else "simulator"
        what = f"a twin needs declared equations, but this system has a {kind}"
        hint = "give your own recording with recording.path=FILE"
        raise InputError(what, where=where("recording.twin"), hint=hint)
