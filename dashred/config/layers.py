"""Merging of the configuration layers: base.yaml, the system's file, command-line overrides."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from os.path import abspath
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, ListConfig, OmegaConf, ValidationError

from dashred.config.coercion import coerce, evaluate, type_error
from dashred.config.nodes import coordinates_of_nodes
from dashred.config.schema.settings import Settings
from dashred.config.schema.types import Where, kind_at
from dashred.config.source import Source
from dashred.core.errors import InputError
from dashred.core.files.user_path import user_path
from dashred.core.mlflow.store_address import artifacts_address, check_address, is_server
from dashred.physics.system_schema import System

PATHS = (
    "recording.path",
    "recording.sensors",
    "system.nodes",
    "system.snapshots",
    "system.simulator.fmu",
    "system.simulator.template",
    "output",
    "tracking.root",
)
ARTIFACTS = "tracking.artifacts"
# Its first word, and words that begin with ./ or ../, are paths.
COMMAND = "system.simulator.command"
# Required keys of a system that is declared by equations.
REQUIRED_WITH_EQUATIONS = ("equations", "start")


def where_in(lines: dict[str, str]) -> Where:
    """Return a function that gives the location of a dotted key, or else of its section."""

    def where(key: str) -> str:
        while key and key not in lines:
            key = key[: max(key.rfind("."), key.rfind("["), 0)]
        return lines[key]

    return where


def prepare(source: Source, *, folder: Path) -> Source:
    """Check the keys and shapes of a layer; evaluate numbers and make paths absolute.

    Paths are relative to ``folder``.

    Raises:
        InputError: an unknown key, a value of the wrong shape, or an invalid number.
    """
    where = where_in(source.lines)
    values = coerce(written_out(source.values), Settings, "", where)
    for key in PATHS:
        settled = store_root if key == "tracking.root" else absolute_path
        _edit(values, key, str, partial(settled, folder=folder, where=where(key)))
    _edit(values, ARTIFACTS, str, partial(artifacts_address, where=where(ARTIFACTS)))
    _edit(values, COMMAND, list, partial(absolute_words, folder=folder, where=where(COMMAND)))
    return Source(values, source.lines)


def absolute_path(text: str, *, folder: Path, where: str) -> str:
    """Return an absolute path.

    Raises:
        InputError: the text is not a valid path.
    """
    if "://" in text:
        what, hint = "this is a URL, not a local file or folder", "download it first"
        raise InputError(what, where=where, hint=hint)
    return abspath(folder / user_path(text, where))


def absolute_words(words: list[str], *, folder: Path, where: str) -> list[str]:
    """Return a command with absolute paths; a first word without a slash is found in ``PATH``.

    Raises:
        InputError: a word is not a valid path.
    """
    return [
        absolute_path(word, folder=folder, where=where)
        if word.startswith(("./", "../")) or (index == 0 and "/" in word)
        else word
        for index, word in enumerate(words)
    ]


def store_root(text: str, *, folder: Path, where: str) -> str:
    """Return the root of the MLflow store: an absolute path, or the address of a server.

    Raises:
        InputError: the text is neither a valid path nor a valid address.
    """
    check_address(text, where)
    return text if is_server(text) else absolute_path(text, folder=folder, where=where)


def merge(defaults: Source, system: Source, overrides: Source) -> Settings:
    """Merge the layers, in order of increasing priority, into a checked tree of dataclasses.

    Raises:
        InputError: a value of the wrong type, two recordings in one layer, or a missing key.
    """
    tree: DictConfig = OmegaConf.structured(Settings)
    lines: dict[str, str] = {}
    for layer in _keep_one_recording([defaults, system, overrides]):
        lines |= layer.lines
        values = _as_attributes(layer.values)
        _check_containers(tree, values, "", where_in(lines))
        try:
            merged = OmegaConf.merge(tree, values)
        except ValidationError as error:
            raise _merge_error(error, layer.values, where_in(lines)) from None
        assert isinstance(merged, DictConfig)
        tree = merged
    if missing := sorted({*OmegaConf.missing_keys(tree), *_missing_equations(tree)}):
        where = where_in(system.lines)
        raise InputError(f"missing: {', '.join(missing)}", where=where(missing[0]))
    settings = OmegaConf.to_object(tree)
    assert isinstance(settings, Settings)
    _fill_derived_values(settings, where_in(lines))
    return settings


def _check_containers(tree: DictConfig, values: dict[str, Any], parent: str, where: Where) -> None:
    """Check that no section of keys replaces a list, nor a list a section.

    Keys that take values of several types may do so, and OmegaConf cannot merge them.

    Raises:
        InputError: one does.
    """
    if tree._is_none():
        return
    for name, value in values.items():
        before = tree._get_node(name) if name in tree else None
        key = f"{parent}{name}"
        both = isinstance(before, DictConfig | ListConfig) and isinstance(value, dict | list)
        if both and isinstance(before, ListConfig) != isinstance(value, list):
            was, now = (
                ("a list", "a section of keys")
                if isinstance(before, ListConfig)
                else ("a section of keys", "a list")
            )
            raise InputError(f"{key} must be {was}, not {now}", where=where(key))
        if isinstance(before, DictConfig) and isinstance(value, dict):
            _check_containers(before, value, f"{key}.", where)


def _as_attributes(values: dict[str, Any]) -> dict[str, Any]:
    """Return a layer with the names of the schema's attributes: ``class`` becomes ``class_``."""
    system = values.get("system", {})
    if "class" not in system:
        return values
    named = {("class_" if key == "class" else key): value for key, value in system.items()}
    return values | {"system": named}


def _missing_equations(tree: DictConfig) -> list[str]:
    """Return the missing keys of a system's equations; none if it is given as snapshots."""
    if OmegaConf.select(tree, "system.snapshots") is not None:
        return []
    keys = [f"system.{key}" for key in REQUIRED_WITH_EQUATIONS]
    external = "system.class_", "system.simulator"
    if any(OmegaConf.select(tree, key) is not None for key in external):
        keys.remove("system.equations")
    return [key for key in keys if OmegaConf.select(tree, key) in (None, {})]


def _fill_derived_values(settings: Settings, where: Where) -> None:
    """Fill in defaults that depend on other keys."""
    system = settings.system
    settings.recording.reads = settings.recording.reads or list(system.fields)
    if system.nodes is not None:
        system.axes = coordinates_of_nodes(system, where)
    _fill_lengths(system)
    length = system.spread.get("length")
    if isinstance(length, str) and "length" not in system.fields:
        system.spread["length"] = evaluate(length, "system.spread.length", where)


def _fill_lengths(system: System) -> None:
    """Write the length of each axis in place of ``x_length`` in the start."""
    own = {*system.fields, *system.parameters, *system.tables, *system.let}
    for axis, declared in system.axes.items():
        name = f"{axis}_length"
        if name in own:
            continue
        for field, start in system.start.items():
            if isinstance(start, str):
                system.start[field] = re.sub(rf"\b{name}\b", f"{declared.length!r}", start)


def written_out(values: dict[str, Any]) -> dict[str, Any]:
    """Return a layer with its short forms written out.

    They are the twin called null, which YAML reads as None, and a column in place of an input.
    """
    recording, system = values.get("recording"), values.get("system")
    if isinstance(recording, dict) and "twin" in recording and recording["twin"] is None:
        values = values | {"recording": recording | {"twin": "null"}}
    if isinstance(system, dict) and isinstance(inputs := system.get("inputs"), dict):
        sections = {n: {"column": i} if isinstance(i, str) else i for n, i in inputs.items()}
        values = values | {"system": system | {"inputs": sections}}
    return values


def _keep_one_recording(layers: list[Source]) -> list[Source]:
    """Keep only the recording (twin or path) of the layer with the highest priority."""
    decided = False
    kept: list[Source] = []
    for layer in reversed(layers):
        recording = dict(layer.values.get("recording", {}))
        chosen = [key for key in ("twin", "path") if recording.get(key) is not None]
        if len(chosen) == 2:
            raise InputError(
                "recording.twin and recording.path are both given",
                where=layer.lines["recording.path"],
                hint="keep the one to analyse",
            )
        if decided:
            recording |= {"twin": None, "path": None}
        decided = decided or bool(chosen)
        kept.append(Source(layer.values | {"recording": recording}, layer.lines))
    return kept[::-1]


def _merge_error(error: ValidationError, values: dict[str, Any], where: Where) -> InputError:
    key = str(error.full_key)
    value: Any = values
    for part in key.replace("[", ".").replace("]", "").split("."):
        value = value[int(part)] if isinstance(value, list) else value[part]
    return type_error(value, kind_at(key, where), key, where)


def _edit(values: dict[str, Any], key: str, kind: type, change: Callable[[Any], Any]) -> None:
    """Change one value in a nested dict, if it exists and is of this kind."""
    *sections, name = key.split(".")
    for section in sections:
        values = values.get(section) or {}
    if isinstance(values.get(name), kind):
        values[name] = change(values[name])
