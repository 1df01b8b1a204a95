"""Plan the rows of a benchmark: their runs, folders and identity."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from dashred.config import Config, config_sha256, load_config
from dashred.core.command_line.arguments import COMMAND_LINE
from dashred.core.errors import InputError
from dashred.core.mlflow.store_address import StorePlace
from dashred.evaluation.benchmark.arguments import Request
from dashred.evaluation.twins.twin_file import (
    hides_law,
    hides_nothing,
    names_with_simulator_start,
    read_entry,
)

EXPERIMENT = "bench"


@dataclass(frozen=True)
class Row:
    """One run.

    Attributes:
        name: name of the system, without its path.
        sensors: number of fit sensors; None for that of the system.
        extra: number of fit sensors that are not input of SHRED; None for that of the system.
        null: whether the twin hides nothing.
        law: whether the twin hides terms or parameter values; other hidden causes do not change
            the law.
        key: everything that determines the findings, except the code.
        words: arguments of ``dashred train``, without the location of the results.
        store: the MLflow store.
    """

    name: str
    twin: str
    noise: float
    seed: int
    sensors: int | None
    extra: int | None
    null: bool
    law: bool
    key: dict[str, Any]
    words: tuple[str, ...]
    folder: Path
    store: StorePlace

    def __str__(self) -> str:
        """Return the name of the row: ``rde b, noise 0.05, 8 sensors, seed 1``."""
        sensor_arguments = [f"{self.sensors} sensors"] if self.sensors is not None else []
        sensor_arguments += [f"{self.extra} of them extra"] if self.extra is not None else []
        parts = [
            f"{self.name} {self.twin}",
            f"noise {self.noise:g}",
            *sensor_arguments,
            f"seed {self.seed}",
        ]
        return ", ".join(parts)


def plan(request: Request) -> list[Row]:
    """Check the arguments of all runs and return the rows in order.

    Raises:
        InputError: a run would refuse its input: an unknown system, twin or key, or a wrong value.
    """
    rows: list[Row] = []
    sources: dict[str, Path | None] = {}
    for system in request.systems:
        config = _config(system, request, "recording.twin=null")
        if sources.setdefault(config.name, config.source) != config.source:
            raise InputError(
                f"two systems are called {config.name}",
                where=COMMAND_LINE,
                hint="rename one of the files",
            )
        for noise, sensors, extra in product(request.noise, request.sensors, request.extra):
            sensor_arguments = _sensor_arguments(sensors, extra).values()
            words = ("recording.twin=null", f"recording.noise={noise:.12g}", *sensor_arguments)
            _config(system, request, *words)
        rows += _rows_of(system, config, request)
    return list({row.folder: row for row in rows}.values())


def _config(system: str, request: Request, *words: str) -> Config:
    return load_config([f"conf={system}", *request.overrides, *words], entry="train")


def _rows_of(system: str, config: Config, request: Request) -> list[Row]:
    twins = names_with_simulator_start(config) if request.twins is None else request.twins
    hidden = {twin: read_entry(config, twin) for twin in twins}
    tracking = config.tracking
    store = StorePlace(tracking.root, tracking.experiment or EXPERIMENT, tracking.artifacts)
    dimensions = (hidden, request.noise, request.sensors, request.extra, request.seeds)
    sha = config_sha256(config)
    laws = {
        twin: hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()
        for twin, entry in hidden.items()
    }
    rows = []
    for twin, noise, sensors, extra, seed in product(*dimensions):
        sensor_arguments = _sensor_arguments(sensors, extra)
        words = (f"conf={system}", *request.overrides, f"recording.twin={twin}")
        words = (
            *words,
            f"recording.noise={noise:.12g}",
            *sensor_arguments.values(),
            f"seed={seed}",
        )
        key = {
            "system": config.name,
            "twin": twin,
            "noise": noise,
            "seed": seed,
            "config_sha256": sha,
            "law_sha256": laws[twin],
        }
        rows.append(
            Row(
                name=config.name,
                twin=twin,
                noise=noise,
                seed=seed,
                sensors=sensors,
                extra=extra,
                null=hides_nothing(hidden[twin]),
                law=hides_law(hidden[twin]),
                key=key | sensor_arguments,
                words=words,
                folder=request.output
                / config.name
                / _folder(twin, noise, sensor_arguments, seed, request),
                store=store,
            )
        )
    return rows


def _sensor_arguments(sensors: int | None, extra: int | None) -> dict[str, str]:
    """Return the arguments for the sensors by name; empty for those of the system."""
    words = {}
    if sensors is not None:
        words["sensors"] = f"recording.sensors={sensors}"
    if extra is not None:
        words["extra"] = f"splits.sensors.extra={extra}"
    return words


def _folder(
    twin: str, noise: float, sensor_arguments: dict[str, str], seed: int, request: Request
) -> str:
    """Return the folder name of a row; it depends on the overrides, as benchmarks may share DIR."""
    places = "".join(f"-{key}{word.partition('=')[2]}" for key, word in sensor_arguments.items())
    name = f"{twin}-noise{noise:.12g}{places}-seed{seed}"
    relevant = sorted(word for word in request.overrides if not word.startswith("tracking."))
    if not relevant:
        return name
    return f"{name}-{hashlib.sha256(' '.join(relevant).encode()).hexdigest()[:8]}"
