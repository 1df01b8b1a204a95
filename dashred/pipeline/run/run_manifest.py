"""The manifest of a run: its input and its code, so that an interrupted run can be resumed.

The folder `checkpoints`, next to the artifacts of a run, holds its configuration, its manifest and
the results of its stages. An output folder that the user named holds a pointer to the run. All of
them are deleted when the run has succeeded.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from copy import deepcopy
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path
from typing import Any

from dashred.config import Config, config_sha256
from dashred.config.bundled_systems import PACKAGE
from dashred.config.frozen import OUTPUT_SECTIONS, TWIN_ONLY
from dashred.config.layers import COMMAND, PATHS
from dashred.config.schema.settings import Settings
from dashred.core.errors import InputError
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import versions, write_json_atomic
from dashred.physics.system import System

# The checkout, or the folder of installed packages.
ROOT = PACKAGE.parent
PACKAGES = ("dashred", "datamodules", "callbacks")
CONFIGURATION, RECORDING = "the configuration", "the recording"
SNAPSHOTS, CODE = "the snapshots", "the code of dashred"
PROGRAM = "the program that is the simulator"
# File in the output folder with the id of the run that writes there.
POINTER = ".run"
# Tag of a run whose findings are frozen and logged: its analysis is complete.
FROZEN = "findings sha256"
MANIFEST, CONFIG_DIR, WORDS = "began.json", "config", "words.json"
MODEL = "tracking.model"
SECTIONS = {field.name for field in fields(Settings)} - {*OUTPUT_SECTIONS}
# Keys of `recording` that are not stored: the input paths are stored separately, and keys of a twin
# must not reach the analysis.
RECORDING_ONLY = ("twin", "path", "sensors", *TWIN_ONLY)


def manifest_of(config: Config, recording_sha256: str) -> dict[str, str]:
    """Return everything that determines the findings, by name, as strings to compare."""
    inputs = {CONFIGURATION: config_sha256(config), RECORDING: recording_sha256}
    program = System(config.system, config.where).program
    if program is not None:
        inputs[PROGRAM] = program.sha256
    return inputs | environment_manifest()


def environment_manifest() -> dict[str, str]:
    """Return the part of the manifest that does not depend on the input: versions and code."""
    return {CODE: code_sha256(), **versions()}


@cache
def code_sha256() -> str:
    """Return the SHA-256 of the sources; a commit would not cover uncommitted changes."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            digest.update(f"{path.relative_to(ROOT)}\n".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def write_manifest(folder: Path, config: Config, manifest: dict[str, str]) -> None:
    """Write the configuration, arguments and manifest of a run to its checkpoint folder."""
    values = deepcopy(config.written)
    for key in OUTPUT_SECTIONS:
        values.pop(key, None)
    for key in RECORDING_ONLY:
        values.get("recording", {}).pop(key, None)
    # JSON is YAML in which a string is never read as a number.
    text = json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / CONFIG_DIR).mkdir(parents=True, exist_ok=True)
    write_text_atomic(folder / CONFIG_DIR / f"{config.name}.yaml", text)
    write_json_atomic(folder / WORDS, _overrides(config))
    write_json_atomic(folder / MANIFEST, manifest)


def stored_arguments(folder: Path) -> list[str] | None:
    """Return the arguments that repeat the analysis of a run; None if there is no manifest.

    Raises:
        InputError: an argument may be given by the user only, such as ``trust=``.
    """
    if read_manifest(folder) is None:
        return None
    path = folder / WORDS
    try:
        [config_file] = (folder / CONFIG_DIR).glob("*.yaml")
        words = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    for word in words if isinstance(words, list) else [words]:
        if not isinstance(word, str) or not _may_be_stored(word.partition("=")[0]):
            raise InputError(
                f"a run does not store {word!r}: this file was tampered with",
                where=str(path),
                hint="start a new run, without resume=",
            )
    return [f"conf={config_file}", *words]


def _may_be_stored(key: str) -> bool:
    """Whether a run may store the value of a key: not trusted code, and not output locations."""
    section, _, name = key.partition(".")
    if section == "recording":
        return f"{section}.{name}" in PATHS or name not in RECORDING_ONLY
    return key == MODEL or section in SECTIONS


def read_manifest(folder: Path) -> dict[str, str] | None:
    """Return the manifest of a run; None if there is none."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return manifest if isinstance(manifest, dict) else None


def differences(manifest: dict[str, str], now: dict[str, str]) -> list[str]:
    """Describe the changes of a manifest: ``torch was 2.12, is 2.13``."""
    changes = []
    for name, value in now.items():
        before = manifest.get(name)
        if before == value:
            continue
        is_hash = name in (CONFIGURATION, RECORDING, SNAPSHOTS, PROGRAM, CODE)
        changes.append(f"{name} has changed" if is_hash else f"{name} was {before}, is {value}")
    return changes


def write_pointer(output: Path, run_id: str) -> None:
    """Write the id of the run to the output folder that the user named."""
    write_text_atomic(output / POINTER, f"{run_id}\n")


def read_pointer(output: Path | None) -> str | None:
    """Return the id of the interrupted run that wrote to this folder."""
    if output is None or not (output / POINTER).is_file():
        return None
    return (output / POINTER).read_text(encoding="utf-8", errors="replace").strip() or None


def remove_checkpoints(folder: Path, output: Path) -> None:
    """Delete the checkpoints and the pointer of a run."""
    (output / POINTER).unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)


def _overrides(config: Config) -> list[str]:
    """Return the command-line settings, without output locations, and the paths of the input."""
    values = asdict(config)
    settings: dict[str, Any] = {MODEL: config.tracking.model}
    for key, line in config.lines.items():
        section, _, name = key.partition(".")
        if line != config.override_place or not key or "[" in key or section in OUTPUT_SECTIONS:
            continue
        if section != "recording" or name not in RECORDING_ONLY:
            settings[key] = _value_at(values, key)
    for key in (*PATHS, COMMAND):
        value = _value_at(values, key)
        if key.partition(".")[0] not in OUTPUT_SECTIONS and isinstance(value, str | list):
            settings[key] = value
    return [f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in settings.items()]


def _value_at(values: Any, key: str) -> Any:
    for part in key.split("."):
        if values is None:
            return None
        # The key `class` is the attribute `class_`.
        values = values.get(part if part in values else f"{part}_")
    return values
