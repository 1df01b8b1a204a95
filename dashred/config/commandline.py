"""Read the command line of an analysis: the system, and values that override its files."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from dashred.config.bundled_systems import BASE, CONF, bundled_names
from dashred.config.parameter_spreads import plain_key, with_plain_parameters
from dashred.config.schema.types import kind_at, optional, required
from dashred.config.source import Source, check_text, read_text
from dashred.core.command_line.arguments import COMMAND_LINE, key_value_pairs
from dashred.core.errors import InputError, nearest
from dashred.core.files.user_path import user_path

# A system's file may come from someone else. With these keys it could choose which files are
# overwritten, and to which server the results and MLflow's password are sent.
COMMAND_LINE_ONLY = (
    "output",
    "tracking.root",
    "tracking.artifacts",
    "tracking.run",
    "tracking.parent",
)

# Sections to which an override may add entries, and the section that has their names.
NAMED_IN = {"spread": "fields", "parameter_spread": "parameters", "parameter_per": "parameters"}

# Sections whose keys the schema defines.
FIXED_KEYS = ("integrator", "simulator")

USAGE = """\
usage: dashred {entry} conf=SYSTEM [key=value ...]

  conf=SYSTEM   a bundled system ({bundled}), or the path of a YAML file
  key=value     overrides one value: seed=1 recording.noise=0.01 shred.lags=30
                quote what the shell would read: 'system.equations.u=-d(u**2/2, x)'

A twin experiment, whose truth is hidden:  recording.twin=NAME
Your own recording:                        recording.path=FILE [recording.sensors=TABLE.csv]
Run a system's class or simulator:         trust=NAME
Resume a run that was interrupted:         dashred train resume=RUN_ID
Every key with its meaning:                dashred reference

The defaults:

{defaults}"""


def usage(entry: str) -> str:
    """Return the text of ``dashred ENTRY --help``: the arguments, and all defaults."""
    defaults = BASE.read_text(encoding="utf-8")
    return USAGE.format(entry=entry, bundled=", ".join(bundled_names()), defaults=defaults)


def find_system(word: str) -> tuple[Path, str]:
    """Return the file of ``conf=word``, and its name in messages.

    Raises:
        InputError: ``word`` is neither the name of a bundled system nor the path of a YAML file.
    """
    if word in bundled_names():
        return CONF / f"{word}.yaml", f"conf/{word}.yaml"
    path = user_path(word, COMMAND_LINE)
    if path.suffix not in (".yaml", ".yml"):
        what = f"unknown conf {word!r}" if word else "conf= is empty"
        hint = _systems(word)
        if path.suffix == ".csv" and path.is_file():
            what = f"{word} is a recording, not a configuration"
            hint = f"dashred init path={word} writes a first one for it"
        raise InputError(what, where=COMMAND_LINE, hint=hint)
    if not path.is_file():
        raise InputError("there is no such file", where=word, hint=_systems(path.stem))
    if CONF / "twins" in path.resolve().parents:
        raise InputError("a twin's hidden truth is not a system to analyse", where=word)
    if path.resolve() == BASE:
        raise InputError("base.yaml holds the defaults, not a system", where=word)
    return path, word


def parse_arguments(arguments: list[str], *, entry: str) -> tuple[str, Source]:
    """Return the value of ``conf=``, and the overrides as a layer; the last value of a key counts.

    Raises:
        InputError: an argument is not ``key=value``, a key is unknown, or ``conf=`` is missing.
    """
    systems: list[str] = []
    values: dict[str, Any] = {}
    lines = {"": COMMAND_LINE}
    for key, text in key_value_pairs(arguments):
        if key == "conf":
            systems.append(text)
            continue
        full_key = plain_key(_full_key(key, entry), COMMAND_LINE)
        value, keys = _value(full_key, text)
        _put(values, full_key, value)
        values = with_plain_parameters(values, lambda _: COMMAND_LINE)
        lines |= {plain_key(each, COMMAND_LINE): COMMAND_LINE for each in keys}
    if len(systems) != 1:
        what = "which system? conf= is missing" if not systems else "conf= is given twice"
        raise InputError(what, where=COMMAND_LINE, hint=_systems(""))
    return systems[0], Source(values, lines)


def check_overrides(overrides: Source, system: Source) -> None:
    """Check that overrides add no entries to sections whose names the system's file defines.

    Otherwise a misspelt parameter would be a further parameter that no equation uses.

    Raises:
        InputError: an entry is unknown; the hint is the nearest name.
    """
    declared: dict[str, Any] = system.values.get("system", {})
    for section, entries in overrides.values.get("system", {}).items():
        known = declared.get(section)
        if not isinstance(entries, dict) or not isinstance(known, dict) or section in FIXED_KEYS:
            continue
        names = [*known, *declared.get(NAMED_IN.get(section, ""), {})]
        for name in entries:
            if name not in names:
                raise InputError(
                    f"system.{section} has no {name}", where=COMMAND_LINE, hint=nearest(name, names)
                )


def check_private_keys(system: Source) -> None:
    """Check that a system's file does not set where results are written or sent.

    Raises:
        InputError: it does; the hint is the argument for the command line.
    """
    for key in COMMAND_LINE_ONLY:
        if key in system.lines:
            raise InputError(
                f"a system's file cannot set {key}: it could name any folder or server",
                where=system.lines[key],
                hint=f"remove it, and set it on the command line: {key}=...",
            )


def _full_key(key: str, entry: str) -> str:
    return "recording.twin" if entry == "record" and key == "twin" else key


def _value(key: str, text: str) -> tuple[Any, dict[str, str]]:
    """Read a value by the type of its key: text as it is, everything else as YAML."""
    kind = kind_at(key, lambda _: COMMAND_LINE)
    if required(kind) is str and not text.startswith(("'", '"')):
        is_null = text in ("", "null") and optional(kind)
        return None if is_null else check_text(text, where=COMMAND_LINE), {key: COMMAND_LINE}
    try:
        return read_text(text, label=COMMAND_LINE, key=key)
    except InputError as error:
        raise InputError(f"{key}: {error.what}", where=COMMAND_LINE, hint=error.hint) from None


def _put(values: dict[str, Any], key: str, value: Any) -> None:
    *sections, name = key.split(".")
    for section in sections:
        below = values.setdefault(section, {})
        if not isinstance(below, dict):
            raise InputError(f"{section} of {key} is given as a value too", where=COMMAND_LINE)
        values = below
    values[name] = value


def _systems(word: str) -> str:
    close = difflib.get_close_matches(word, bundled_names(), n=1)
    start = f"did you mean conf={close[0]}? " if close else ""
    return f"{start}bundled: {', '.join(bundled_names())}; or the path of a .yaml file"
