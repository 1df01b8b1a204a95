"""The part of a configuration that determines the findings, and its hash."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from dashred.config.schema.settings import Settings

OUTPUT_SECTIONS = ("output", "tracking")
# Where an analysis is computed does not change its findings: another cluster may continue it.
NOT_SETTINGS = (*OUTPUT_SECTIONS, "cluster")
# Keys that apply only to recording a twin, not to an existing recording.
TWIN_ONLY = ("noise", "duration", "reads")
# Keys of a simulator that do not change its results.
NOT_RESULTS = ("keep", "time_limit")
# Keys that are left out if they are empty.
LATER_KEYS = (
    ("system", "units"),
    ("system", "parameter_spread"),
    ("system", "parameter_per"),
    ("system", "tables"),
    ("recording", "angles"),
    ("recording", "average"),
    ("recording", "calibration"),
    ("simulation", "memory"),
)


def frozen_input(config: Settings) -> dict[str, Any]:
    """Return everything that determines the findings as a plain nested dict.

    Output locations and the cluster are omitted, and files are named without their folders, so
    that the result does not depend on where a run is made. The contents of the files are hashed
    with the recording.
    """
    values = {
        field.name: asdict(config)[field.name]
        for field in fields(Settings)
        if field.name not in NOT_SETTINGS
    }
    recording = values["recording"]
    # Keeps the hash of configurations from before these keys were introduced.
    for section, key in LATER_KEYS:
        if not values[section][key]:
            del values[section][key]
    if recording["path"] is not None:
        for key in TWIN_ONLY:
            del recording[key]
        if isinstance(recording["sensors"], int):
            del recording["sensors"]
    for key in ("path", "sensors"):
        if isinstance(recording.get(key), str):
            recording[key] = Path(recording[key]).name
    system = values["system"]
    for given in system["inputs"].values():
        if not given["delay_spread"]:
            del given["delay_spread"]
    name = system.pop("class_")
    if name is not None:
        system["class"] = name
    if system["simulator"] is None:
        del system["simulator"]
    else:
        system["simulator"] = _frozen_simulator(system["simulator"])
    nodes = system.pop("nodes")
    if nodes is not None:
        system["nodes"] = hashlib.sha256(Path(nodes).read_bytes()).hexdigest()
    if system["snapshots"] is None:
        del system["snapshots"]
    else:
        system["snapshots"] = Path(system["snapshots"]).name
    return values


def _frozen_simulator(simulator: dict[str, Any]) -> dict[str, Any]:
    """Return what is set of a simulator, with its files named without their folders."""
    found = {key: value for key, value in simulator.items() if value and key not in NOT_RESULTS}
    for key in ("fmu", "template"):
        if key in found:
            found[key] = Path(found[key]).name
    if "command" in found:
        words = found["command"]
        found["command"] = [Path(w).name if Path(w).is_absolute() else w for w in words]
    return found


def config_sha256(config: Settings) -> str:
    """Return the SHA-256 of the canonical JSON of :func:`frozen_input`."""
    text = json.dumps(frozen_input(config), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
