"""An attempt at an analysis: what it began with, so that one that was cut short can go on.

Beside a run's artifacts, in the folder `checkpoints`, lie its configuration, what it began with,
and what its stages have found. A folder that the user named holds a pointer to that run.
Everything is gone when the run has ended well.
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
from dashred.config.layers import PATHS
from dashred.config.schema.settings import Settings
from dashred.core.errors import InputError
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import versions, write_json_atomic

# The checkout, or the folder of installed packages.
ROOT = PACKAGE.parent
PACKAGES = ("dashred", "datamodules", "callbacks")
CONFIGURATION, RECORDING = "the configuration", "the recording"
SNAPSHOTS, CODE = "the snapshots", "the code of dashred"
# In the folder that the user named: which run writes there.
POINTER = ".run"
# The tag of a run whose findings are frozen and logged: it has nothing left to analyse.
FROZEN = "findings sha256"
BEGAN, SETTLED, WORDS = "began.json", "config", "words.json"
MODEL = "tracking.model"
SECTIONS = {field.name for field in fields(Settings)} - {*OUTPUT_SECTIONS}
# Of a file's recording: what is told anew, or is of a twin alone and no business of the analysis.
OF_ONE_RECORDING = ("twin", "path", "sensors", *TWIN_ONLY)


def manifest_of(config: Config, recording_sha256: str) -> dict[str, str]:
    """Return everything that determines the findings, each as a text to compare."""
    found = {CONFIGURATION: config_sha256(config), RECORDING: recording_sha256}
    return found | present()


def present() -> dict[str, str]:
    """Return the part of it that is the machine's: versions, and the code itself."""
    return {CODE: code_sha256(), **versions()}


@cache
def code_sha256() -> str:
    """SHA-256 over the sources of the analysis: a commit does not tell of changes in the folder."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            digest.update(f"{path.relative_to(ROOT)}\n".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def begin(folder: Path, config: Config, began: dict[str, str]) -> None:
    """Note what an attempt begins with, in the folder of its checkpoints."""
    values = deepcopy(config.written)
    for key in OUTPUT_SECTIONS:
        values.pop(key, None)
    for key in OF_ONE_RECORDING:
        values.get("recording", {}).pop(key, None)
    # JSON is YAML in which no text passes for a number.
    text = json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / SETTLED).mkdir(parents=True, exist_ok=True)
    write_text_atomic(folder / SETTLED / f"{config.name}.yaml", text)
    write_json_atomic(folder / WORDS, _words(config))
    write_json_atomic(folder / BEGAN, began)


def words_of(folder: Path) -> list[str] | None:
    """Return the words that say again what an attempt analyses; None where none has begun.

    Raises:
        InputError: one among them says what only the user does, such as ``trust=``.
    """
    if read_began(folder) is None:
        return None
    place = folder / WORDS
    try:
        [settled] = (folder / SETTLED).glob("*.yaml")
        words = json.loads(place.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    for word in words if isinstance(words, list) else [words]:
        if not isinstance(word, str) or not _may_be_kept(word.partition("=")[0]):
            raise InputError(
                f"{word!r} is no word that a run keeps: this file was tampered with",
                where=str(place),
                hint="begin the run anew, without resume=",
            )
    return [f"conf={settled}", *words]


def _may_be_kept(key: str) -> bool:
    """Whether an attempt may keep the value of a key: whose code runs and where results go, no."""
    section, _, name = key.partition(".")
    if section == "recording":
        return f"{section}.{name}" in PATHS or name not in OF_ONE_RECORDING
    return key == MODEL or section in SECTIONS


def read_began(folder: Path) -> dict[str, str] | None:
    """Return what an attempt began with; None where none has."""
    try:
        began = json.loads((folder / BEGAN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return began if isinstance(began, dict) else None


def differences(began: dict[str, str], now: dict[str, str]) -> list[str]:
    """Say what is other now than it was: ``torch was 2.12, is 2.13``."""
    found = []
    for name, value in now.items():
        before = began.get(name)
        if before == value:
            continue
        plain = name in (CONFIGURATION, RECORDING, SNAPSHOTS, CODE)
        found.append(f"{name} has changed" if plain else f"{name} was {before}, is {value}")
    return found


def point_to(output: Path, run_id: str) -> None:
    """Note in the folder that the user named which run writes there."""
    write_text_atomic(output / POINTER, f"{run_id}\n")


def pointed_to(output: Path | None) -> str | None:
    """Return the id of the run that was cut short while it wrote to this folder."""
    if output is None or not (output / POINTER).is_file():
        return None
    return (output / POINTER).read_text(encoding="utf-8", errors="replace").strip() or None


def end(folder: Path, output: Path) -> None:
    """Take away what only going on needs."""
    (output / POINTER).unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)


def _words(config: Config) -> list[str]:
    """Return what the command line had, where results go left out, and where the input lies."""
    settled, kept = asdict(config), config.tracking
    found = {MODEL: kept.model}
    for key, line in config.lines.items():
        section, _, name = key.partition(".")
        if line != config.override_place or not key or "[" in key or section in OUTPUT_SECTIONS:
            continue
        if section != "recording" or name not in OF_ONE_RECORDING:
            found[key] = _at(settled, key)
    for key in PATHS:
        if key.partition(".")[0] not in OUTPUT_SECTIONS and isinstance(_at(settled, key), str):
            found[key] = _at(settled, key)
    return [f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in found.items()]


def _at(values: Any, key: str) -> Any:
    for part in key.split("."):
        # `class` is `class_` to Python.
        values = values[part if part in values else f"{part}_"]
    return values
