"""The rows of a bench: which runs, in which folders, and what makes two of them the same."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from dashred.benchmark.words import PLACE, Request
from dashred.config import Config, config_sha256, load_config
from dashred.errors import InputError
from dashred.twin_file import basic, entry_of

EXPERIMENT = "bench"


@dataclass(frozen=True)
class Row:
    """One run.

    Attributes:
        name: of the system, without its path.
        null: whether the twin hides nothing.
        key: everything that determines the findings, but for the code.
        words: for ``dashred.train``, without where the results go.
        store: of MLflow: its folder, and the experiment.
    """

    name: str
    twin: str
    noise: float
    seed: int
    null: bool
    key: dict[str, Any]
    words: tuple[str, ...]
    folder: Path
    store: tuple[str, str]

    def __str__(self) -> str:
        """As a line begins: ``rde b, noise 0.05, seed 1``."""
        return f"{self.name} {self.twin}, noise {self.noise:g}, seed {self.seed}"


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
        for noise in request.noise:
            _config(system, request, "recording.twin=null", f"recording.noise={noise:.12g}")
        rows += _rows_of(system, config, request)
    return list({row.folder: row for row in rows}.values())


def _config(system: str, request: Request, *words: str) -> Config:
    return load_config([f"conf={system}", *request.overrides, *words], entry="train")


def _rows_of(system: str, config: Config, request: Request) -> list[Row]:
    twins = basic(config) if request.twins is None else request.twins
    hidden = {twin: entry_of(config, twin) for twin in twins}
    sha = config_sha256(config)
    store = (config.tracking.root, config.tracking.experiment or EXPERIMENT)
    rows = []
    for twin, noise, seed in product(hidden, request.noise, request.seeds):
        law = hashlib.sha256(json.dumps(hidden[twin], sort_keys=True).encode()).hexdigest()
        key = {
            "system": config.name,
            "twin": twin,
            "noise": noise,
            "seed": seed,
            "config_sha256": sha,
            "law_sha256": law,
        }
        words = (f"conf={system}", *request.overrides, f"recording.twin={twin}")
        rows.append(
            Row(
                name=config.name,
                twin=twin,
                noise=noise,
                seed=seed,
                null=not hidden[twin].get("terms"),
                key=key,
                words=(*words, f"recording.noise={noise:.12g}", f"seed={seed}"),
                folder=request.output / config.name / _folder(twin, noise, seed, request),
                store=store,
            )
        )
    return rows


def _folder(twin: str, noise: float, seed: int, request: Request) -> str:
    """Name a row's folder; overrides give it another, so that benches of several can share one."""
    name = f"{twin}-noise{noise:.12g}-seed{seed}"
    changing = sorted(word for word in request.overrides if not word.startswith("tracking."))
    if not changing:
        return name
    return f"{name}-{hashlib.sha256(' '.join(changing).encode()).hexdigest()[:8]}"
