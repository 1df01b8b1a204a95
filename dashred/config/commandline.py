"""The words of a command line: which system, and the values that override its files."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from dashred.config.bundled_systems import BASE, CONF, bundled
from dashred.config.schema.types import kind_at, optional, required
from dashred.config.source import Source, check_text, read_text
from dashred.core.arguments import PLACE, pairs
from dashred.core.errors import InputError, nearest
from dashred.core.files.user_path import user_path

# A stranger's file that held them would choose what is written over on this disk, and to whom the
# results and MLflow's password are sent.
OF_THE_USER_ALONE = ("output", "tracking.root", "tracking.run", "tracking.parent")

USAGE = """\
usage: dashred {entry} conf=SYSTEM [key=value ...]

  conf=SYSTEM   a bundled system ({bundled}), or the path of a YAML file
  key=value     overrides one value: seed=1 recording.noise=0.01 shred.lags=30
                quote what the shell would read: 'system.equations.u=-d(u**2/2, x)'

A twin experiment, whose truth is hidden:  recording.twin=NAME
Your own recording:                        recording.path=FILE [recording.sensors=TABLE.csv]
Run the code of a system's Python class:   trust=MODULE.CLASS
Resume a run that was interrupted:         dashred train resume=RUN_ID
Every key with its meaning:                dashred reference

The defaults:

{defaults}"""


def usage(entry: str) -> str:
    """What ``dashred ENTRY --help`` prints: the words it takes, and every default."""
    defaults = BASE.read_text(encoding="utf-8")
    return USAGE.format(entry=entry, bundled=", ".join(bundled()), defaults=defaults)


def find_system(word: str) -> tuple[Path, str]:
    """The file that ``conf=word`` means, and its name in messages.

    Raises:
        InputError: neither a bundled name nor a file of a system.
    """
    if word in bundled():
        return CONF / f"{word}.yaml", f"conf/{word}.yaml"
    path = user_path(word, PLACE)
    if path.suffix not in (".yaml", ".yml"):
        what = f"unknown conf {word!r}" if word else "conf= is empty"
        hint = _systems(word)
        if path.suffix == ".csv" and path.is_file():
            what = f"{word} is a recording, no configuration"
            hint = f"dashred init path={word} writes a first one for it"
        raise InputError(what, where=PLACE, hint=hint)
    if not path.is_file():
        raise InputError("there is no such file", where=word, hint=_systems(path.stem))
    if CONF / "twins" in path.resolve().parents:
        raise InputError("a twin's hidden truth is not a system to analyse", where=word)
    if path.resolve() == BASE:
        raise InputError("base.yaml holds the defaults, not a system", where=word)
    return path, word


def split_words(words: list[str], *, entry: str) -> tuple[str, Source]:
    """The word of ``conf=``, and the overrides as a layer; a later word wins over an earlier one.

    Raises:
        InputError: a word that is not ``key=value``, an unknown key, or no ``conf=``.
    """
    chosen: list[str] = []
    values: dict[str, Any] = {}
    lines = {"": PLACE}
    for key, text in pairs(words):
        if key == "conf":
            chosen.append(text)
            continue
        value, keys = _value(_spelt_out(key, entry), text)
        _put(values, _spelt_out(key, entry), value)
        lines |= dict.fromkeys(keys, PLACE)
    if len(chosen) != 1:
        what = "which system? conf= is missing" if not chosen else "conf= is given twice"
        raise InputError(what, where=PLACE, hint=_systems(""))
    return chosen[0], Source(values, lines)


def check_overrides(overrides: Source, system: Source) -> None:
    """Refuse a new entry in a section whose names the system's own file settles.

    Otherwise a misspelt parameter would be one more parameter, which nothing reads.

    Raises:
        InputError: with the nearest name.
    """
    declared: dict[str, Any] = system.values.get("system", {})
    for section, entries in overrides.values.get("system", {}).items():
        known = declared.get(section)
        if not isinstance(entries, dict) or not isinstance(known, dict) or section == "integrator":
            continue
        for name in entries:
            if name not in known and not (
                section == "spread" and name in declared.get("fields", {})
            ):
                raise InputError(
                    f"system.{section} has no {name}", where=PLACE, hint=nearest(name, known)
                )


def check_places(system: Source) -> None:
    """Refuse a system's file that says where results go: that is the user's own to say.

    Raises:
        InputError: with the word of the command line that would say it.
    """
    for key in OF_THE_USER_ALONE:
        if key in system.lines:
            raise InputError(
                f"a system's file does not say {key}: it could name any folder or server",
                where=system.lines[key],
                hint=f"leave it out, and say it on the command line: {key}=...",
            )


def _spelt_out(key: str, entry: str) -> str:
    return "recording.twin" if entry == "record" and key == "twin" else key


def _value(key: str, text: str) -> tuple[Any, dict[str, str]]:
    """Read a word's value by the kind of its key: a text as it stands, all else as YAML."""
    kind = kind_at(key, lambda _: PLACE)
    if required(kind) is str and not text.startswith(("'", '"')):
        nothing = text in ("", "null") and optional(kind)
        return None if nothing else check_text(text, where=PLACE), {key: PLACE}
    try:
        return read_text(text, label=PLACE, key=key)
    except InputError as error:
        raise InputError(f"{key}: {error.what}", where=PLACE, hint=error.hint) from None


def _put(values: dict[str, Any], key: str, value: Any) -> None:
    *sections, name = key.split(".")
    for section in sections:
        below = values.setdefault(section, {})
        if not isinstance(below, dict):
            raise InputError(f"{section} of {key} is given as a value too", where=PLACE)
        values = below
    values[name] = value


def _systems(word: str) -> str:
    close = difflib.get_close_matches(word, bundled(), n=1)
    start = f"did you mean conf={close[0]}? " if close else ""
    return f"{start}bundled: {', '.join(bundled())}; or the path of a .yaml file"
