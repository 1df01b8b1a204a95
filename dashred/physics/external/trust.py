"""Programs that the user has trusted in this process; no other program is started."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.core.errors import InputError
from dashred.physics.system_schema import ExternalSimulator

_trusted: set[str] = set()


def trust(name: str) -> None:
    """Allow a program to run in this process; only the user's own words may lead here."""
    _trusted.add(name)


def check_trusted(name: str, place: str) -> None:
    """Check that the user has trusted a program in this process.

    Raises:
        InputError: the program is not trusted.
    """
    if name not in _trusted:
        raise not_trusted(name, place)


def not_trusted(name: str, place: str, words: Sequence[str] = ()) -> InputError:
    """Return the error of a program that is not trusted, which shows all words of a command."""
    return InputError(
        f"this system runs {' '.join(words) or name}, with all your permissions",
        where=place,
        hint=f"read it first; if you trust it, add trust={name} to the command line",
    )


def names_of(simulator: ExternalSimulator) -> dict[str, str]:
    """Return the names that are to be trusted, by key; the checked simulator has one."""
    words = simulator.command
    named = {
        "function": simulator.function,
        "run": simulator.run,
        "fmu": simulator.fmu,
        "command": None if words is None else "".join(words[:1]),
    }
    return {key: name for key, name in named.items() if name is not None}
