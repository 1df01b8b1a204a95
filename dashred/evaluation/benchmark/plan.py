"""The rows of a bench: which runs, in which folders, and what makes two of them the same."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from dashred.config import Config, config_sha256, load_config
from dashred.core.arguments import PLACE
from dashred.core.errors import InputError
from dashred.evaluation.benchmark.arguments import Request
from dashred.evaluation.twins.twin_file import names_with_simulator_start, read_entry, hides_law, hides_nothing

EXPERIMENT = "bench"


@dataclass(frozen=True)
class Row:
    """One run.

    Attributes:
        name: of the system, without its path.
        sensors: fit sensors; None for the system's own number.
        extra: of them, those that SHRED's input is without; None for the system's own number.
        null: whether the twin hides nothing.
        law: whether it hides terms, or parameters' values; what else it hides (a sensor's fault, a
            wide start) leaves the simulator's law right.
        key: everything that determines the findings, but for the code.
        words: for ``dashred.train``, without where the results go.
        store: of MLflow: its folder, and the experiment.
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
    store: tuple[str, str]

    def __str__(self) -> str:
        """As a line begins: ``rde b, noise 0.05, 8 sensors, seed 1``."""
        placed = [f"{self.sensors} sensors"] if self.sensors is not None else []
        placed += [f"{self.extra} of them extra"] if self.extra is not None else []
        parts = [f"{self.name} {self.twin}", f"noise {self.noise:g}", *placed, f"seed {self.seed}"]
        return ", ".join(parts)


def plan(request: Request) -> list[Row]:
    """Check every word that the runs will get, and return them in order.

    Raises:
        InputError: anything that a run would refuse: an unknown system, twin or key, a wrong value.
    """
    rows: list[Row] = []
    sources: dict[str, Path] = {}
    for system in request.systems:
        config = _config(system, request, "recording.twin=null")
        if sources.setdefault(config.name, config.source) != config.source:
            raise InputError(
                f"two systems are called {config.name}", where=PLACE, hint="rename one of the files"
            )
        for noise, sensors, extra in product(request.noise, request.sensors, request.extra):
            placed = _placed(sensors, extra).values()
            words = ("recording.twin=null", f"recording.noise={noise:.12g}", *placed)
            _config(system, request, *words)
        rows += _rows_of(system, config, request)
    return list({row.folder: row for row in rows}.values())


def _config(system: str, request: Request, *words: str) -> Config:
    return load_config([f"conf={system}", *request.overrides, *words], entry="train")


def _rows_of(system: str, config: Config, request: Request) -> list[Row]:
    twins = names_with_simulator_start(config) if request.twins is None else request.twins
    hidden = {twin: read_entry(config, twin) for twin in twins}
    store = (config.tracking.root, config.tracking.experiment or EXPERIMENT)
    dimensions = (hidden, request.noise, request.sensors, request.extra, request.seeds)
    sha = config_sha256(config)
    laws = {
        twin: hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()
        for twin, entry in hidden.items()
    }
    rows = []
    for twin, noise, sensors, extra, seed in product(*dimensions):
        placed = _placed(sensors, extra)
        words = (f"conf={system}", *request.overrides, f"recording.twin={twin}")
        words = (*words, f"recording.noise={noise:.12g}", *placed.values(), f"seed={seed}")
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
                key=key | placed,
                words=words,
                folder=request.output / config.name / _folder(twin, noise, placed, seed, request),
                store=store,
            )
        )
    return rows


def _placed(sensors: int | None, extra: int | None) -> dict[str, str]:
    """Return the words that place sensors, by what they say; none for the system's own."""
    words = {}
    if sensors is not None:
        words["sensors"] = f"recording.sensors={sensors}"
    if extra is not None:
        words["extra"] = f"splits.sensors.extra={extra}"
    return words


def _folder(twin: str, noise: float, placed: dict[str, str], seed: int, request: Request) -> str:
    """Name a row's folder; overrides give it another, so that benches of several can share one."""
    places = "".join(f"-{key}{word.partition('=')[2]}" for key, word in placed.items())
    name = f"{twin}-noise{noise:.12g}{places}-seed{seed}"
    changing = sorted(word for word in request.overrides if not word.startswith("tracking."))
    if not changing:
        return name
    return f"{name}-{hashlib.sha256(' '.join(changing).encode()).hexdigest()[:8]}"
