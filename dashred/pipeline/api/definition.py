"""Definition of a system in Python: a bundled name, a YAML file or a dict, with overrides."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dashred.config import Config, Source, build_config, read_file
from dashred.config.commandline import find_system
from dashred.config.source_dict import overrides_from_dict, source_from_dict
from dashred.core.command_line.arguments import COMMAND_LINE
from dashred.core.errors import InputError

OVERRIDES, DICT, NAME = "overrides", "dict", "system"
# Keys of the configuration that have no effect in this API, with a hint.
UNSUPPORTED = {
    "output": "Result.save(folder) writes the files",
    "tracking": "this API does not use MLflow",
}


@dataclass(frozen=True)
class Definition:
    """A system and the values that override its configuration.

    Attributes:
        written: values of the configuration, as they were written.
        name: name of the system.
        source: file of the configuration; None for a dict.
        overrides: values that override the configuration, by dotted or nested keys.
        places: names that error messages use for overrides that were arguments, by key.
        trust: name of the class, function, FMU or command whose code may run.
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
            InputError: a value is invalid.
        """
        values = dict(self.overrides) if seed is None else {**self.overrides, "seed": seed}
        overrides = overrides_from_dict(values, OVERRIDES)
        for key, hint in UNSUPPORTED.items():
            if key in overrides.values:
                raise InputError(f"{key} cannot be set here", where=OVERRIDES, hint=hint)
        overrides.lines.update(self.places)
        try:
            return build_config(
                self.written, overrides, name=self.name, source=self.source, trust=self.trust
            )
        except InputError as error:
            raise _with_place(error, OVERRIDES) from None


def from_file(
    system: str | os.PathLike[str],
    overrides: Mapping[str, Any],
    places: Mapping[str, str],
    trust: str | None,
) -> Definition:
    """Return a bundled system by name, or a system from a YAML file.

    Raises:
        InputError: the system does not exist, or its file cannot be read.
    """
    try:
        path, label = find_system(os.fspath(system))
    except InputError as error:
        raise _with_place(error, "from_yaml") from None
    written = read_file(path, label=label)
    return Definition(written, path.stem, path.resolve(), overrides, places, trust)


def _with_place(error: InputError, place: str) -> InputError:
    """Return an error of the command line as an error of the named Python argument."""
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
    """Return a system that is given as a dict.

    Raises:
        InputError: the dict contains a value that YAML cannot represent.
    """
    return Definition(source_from_dict(values, DICT), name, None, overrides, places, trust)
