"""The part of a configuration that determines the findings, and its hash."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from dashred.config.schema.settings import Settings

ELSEWHERE = ("output", "tracking")
# How a twin is recorded says nothing about a recording that is there already.
RECORDING_A_TWIN = ("noise", "duration", "reads")


def frozen_input(config: Settings) -> dict[str, Any]:
    """The plain nested dict of everything that determines the findings.

    Where results go is left out, and files are named without their folder: a run in another
    place is the same run. What the files hold is hashed with the recording, not here.
    """
    values = {
        field.name: asdict(config)[field.name]
        for field in fields(Settings)
        if field.name not in ELSEWHERE
    }
    if not values["system"]["units"]:
        # What states no unit is the run that it was before units could be stated.
        del values["system"]["units"]
    recording = values["recording"]
    if recording["path"] is not None:
        for key in RECORDING_A_TWIN:
            del recording[key]
        if isinstance(recording["sensors"], int):
            del recording["sensors"]
    for key in ("path", "sensors"):
        if isinstance(recording.get(key), str):
            recording[key] = Path(recording[key]).name
    system = values["system"]
    name = system.pop("class_")
    if name is not None:
        system["class"] = name
    if system["snapshots"] is None:
        del system["snapshots"]
    else:
        system["snapshots"] = Path(system["snapshots"]).name
    return values


def config_sha256(config: Settings) -> str:
    """SHA-256 of the canonical JSON of :func:`frozen_input`."""
    text = json.dumps(frozen_input(config), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
