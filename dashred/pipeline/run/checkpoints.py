"""Results of the stages of an analysis on disk, from which an interrupted run resumes.

Files are loaded with ``weights_only=True``: tensors, numbers, strings and the records listed here.
A manipulated file can name no other class and no function. Results of another version of the code
are computed again.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from numpy._core.multiarray import _reconstruct  # how NumPy pickles an array

from dashred.core.budget import Budget
from dashred.core.files.atomic import atomic_file
from dashred.core.progress import say
from dashred.inference.fit.law import ErrorCurve, Law, SensorFault
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.hypotheses.result import BestOfSize, Discovery
from dashred.inference.latent_sindy.sparse_regression import SparseFit
from dashred.physics.expressions import nodes
from dashred.physics.system import Term
from dashred.physics.window import Shape, Window
from dashred.pipeline.networks.assimilation import AssimilationResult
from dashred.pipeline.networks.training import StoredNetwork, TrainedNetwork
from dashred.pipeline.run.provenance import git_commit

Result = TypeVar("Result")

EXPRESSIONS = (
    *(nodes.Number, nodes.Name, nodes.Sum, nodes.Product),
    *(nodes.Power, nodes.Call, nodes.Derivative, nodes.Flux, nodes.Where),
)
RECORDS = (
    *(AssimilationResult, SparseFit, Discovery, BestOfSize, Law, SensorFault, ErrorCurve),
    *(Candidate, Term, Window, Shape, NoiseModel, ForcingMap, StoredNetwork, *EXPRESSIONS),
)
ARRAYS: tuple[Any, ...] = (
    np.ndarray,
    np.dtype,
    _reconstruct,
    *map(type, map(np.dtype, ("f8", "f4", "i8", "?"))),
)
UNREADABLE = (OSError, EOFError, RuntimeError, KeyError, pickle.UnpicklingError)


class Stages(Protocol):
    """Runs the stages of an analysis."""

    def stage(self, name: str, compute: Callable[[], Result]) -> Result:
        """Return the result of a stage."""


class NoCheckpoints:
    """Runs every stage without storing its result."""

    def stage(self, name: str, compute: Callable[[], Result]) -> Result:
        """Compute the result of a stage."""
        return compute()


class Checkpoints:
    """Checkpoints of the stages of a run, one file per stage.

    Args:
        folder: folder of the files.
        seconds: run time by stage; a stage that is read back adds its original run time.
        budget: of the run; a stage that is read back adds what it had left out.

    Attributes:
        earlier: total original run time in seconds of the stages that were read back.
    """

    def __init__(self, folder: Path, seconds: dict[str, float], budget: Budget) -> None:
        self.folder, self.seconds, self.budget = folder, seconds, budget
        self.earlier = 0.0

    def stage(self, name: str, compute: Callable[[], Result]) -> Result:
        """Return the result of a stage: from its checkpoint if there is one, or computed now."""
        path = self.folder / f"{name}.pt"
        stored, code = _read(path), git_commit()
        # Records of another version may lack attributes, and findings must come from one version.
        if stored is not None and stored.get("code") == code:
            self.seconds |= stored["seconds"]
            self.earlier += stored["took"]
            for what in stored["left_out"]:
                self.budget.leave_out(what)
            say(f"  {name:<28} read from its checkpoint")
            return _restored(stored["found"])
        before, started = dict(self.seconds), time.perf_counter()
        known = len(self.budget.not_tried)
        result = compute()
        took = time.perf_counter() - started
        own = {title: s for title, s in self.seconds.items() if before.get(title) != s}
        content = {"found": _plain(result), "seconds": own, "took": took, "code": code}
        _write(path, content | {"left_out": self.budget.not_tried[known:]})
        return result


def _plain(result: Any) -> Any:
    if isinstance(result, tuple):
        return tuple(map(_plain, result))
    return StoredNetwork.of(result) if isinstance(result, TrainedNetwork) else result


def _restored(stored: Any) -> Any:
    if isinstance(stored, tuple):
        return tuple(map(_restored, stored))
    return stored.restored() if isinstance(stored, StoredNetwork) else stored


def _write(path: Path, content: dict[str, Any]) -> None:
    # torch hides the cause when the disk is full; writing its bytes ourselves raises OSError.
    buffer = BytesIO()
    torch.save(content, buffer)
    with atomic_file(path) as partial:
        partial.write_bytes(buffer.getvalue())


def _read(path: Path) -> dict[str, Any] | None:
    """Return the content of a file; None if it is missing or unreadable."""
    if not path.is_file():
        return None
    with torch.serialization.safe_globals([*RECORDS, *ARRAYS]):
        try:
            return torch.load(path, map_location="cpu", weights_only=True)
        except UNREADABLE:
            return None
