"""A system as Python code names it: a bundled name, a YAML file, or a dict; with overrides."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dashred.config import Config, Source, build_config, read_file
from dashred.config.commandline import find_system
from dashred.config.source_dict import overrides_from_dict, source_from_dict
from dashred.core.arguments import COMMAND_LINE
from dashred.core.errors import InputError

OVERRIDES, DICT, NAME = "overrides", "dict", "system"
# The recording is an argument of its own, and results go where Result.save is told.
NOT_HERE = {
    "output": "Result.save(folder) writes the files",
    "tracking": "this API keeps nothing in MLflow",
}


@dataclass(frozen=True)
class Definition:
    """A system, and what lies over its values.

    Attributes:
        written: its values, as they were written.
        name: of the system.
        source: its file; None for a dict.
        overrides: values over it, by dotted or nested keys.
        places: what messages call an override that was an argument of its own.
        trust: ``MODULE.CLASS`` of a simulator in Python whose code may run.
    """

    written: Source
    name: str
    source: Path | None
    overrides: Mapping[str, Any]
    places: Mapping[str, str]
    trust: str | None = None

    def config(self, seed: int | None = None) -> Config:
        """Return the checked configuration.

        Raises:
            InputError: anything wrong in the values.
        """
        values = dict(self.overrides) if seed is None else {**self.overrides, "seed": seed}
        overrides = overrides_from_dict(values, OVERRIDES)
        for key, advice in NOT_HERE.items():
            if key in overrides.values:
                raise InputError(f"{key} cannot be set here", where=OVERRIDES, hint=advice)
        overrides.lines.update(self.places)
        try:
            return build_config(
                self.written, overrides, name=self.name, source=self.source, trust=self.trust
            )
        except InputError as error:
            raise _placed(error, OVERRIDES) from None


def from_file(
    system: str | os.PathLike[str],
    overrides: Mapping[str, Any],
    places: Mapping[str, str],
    trust: str | None,
) -> Definition:
    """Return a bundled system by name, or one from a YAML file.

    Raises:
        InputError: there is no such system, or its file cannot be read.
    """
    try:
        path, label = find_system(os.fspath(system))
    except InputError as error:
        raise _placed(error, "from_yaml") from None
    written = read_file(path, label=label)
    return Definition(written, path.stem, path.resolve(), overrides, places, trust)


def _placed(error: InputError, place: str) -> InputError:
    """Return the error with the place of Python's arguments for that of a command line's words."""
    if error.where != COMMAND_LINE:
        return error
    return InputError(error.what, where=place, hint=error.hint)


def from_values(
    values: Mapping[str, Any],
    name: str,
    overrides: Mapping[str, Any],
    places: Mapping[str, str],
    trust: str | None,
) -> Definition:
    """Return a system that is a dict.

    Raises:
        InputError: it holds what YAML could not.
    """
    return Definition(source_from_dict(values, DICT), name, None, overrides, places, trust)
