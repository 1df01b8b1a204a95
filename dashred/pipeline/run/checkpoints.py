"""What the stages of an analysis have found so far, on disk: an attempt that was cut short goes on.

Read back with weights only: tensors, numbers, texts, and the records of findings listed here. A
file that was tampered with can name no other class, and no function at all. What other code has
found is found again.
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

from dashred.core.files.atomic import atomic_file
from dashred.core.progress import say
from dashred.inference.fit.law import Law, SensorFault
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.hypotheses.result import BestOfSize, Discovery
from dashred.inference.latent_sindy.sparse_regression import SparseFit
from dashred.physics.expressions import nodes
from dashred.physics.system import Term
from dashred.physics.window import Shape, Window
from dashred.pipeline.assimilation import Assimilated
from dashred.pipeline.run.provenance import git_commit
from dashred.pipeline.training import KeptNetwork, Learned

Found = TypeVar("Found")

EXPRESSIONS = (
    *(nodes.Number, nodes.Name, nodes.Sum, nodes.Product),
    *(nodes.Power, nodes.Call, nodes.Derivative, nodes.Flux),
)
RECORDS = (
    *(Assimilated, SparseFit, Discovery, BestOfSize, Law, SensorFault, Candidate, Term),
    *(Window, Shape, NoiseModel, ForcingMap, KeptNetwork, *EXPRESSIONS),
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

    def stage(self, name: str, find: Callable[[], Found]) -> Found:
        """Return what a stage finds."""


class NoCheckpoints:
    """Runs every stage, and keeps nothing of it."""

    def stage(self, name: str, find: Callable[[], Found]) -> Found:
        """Return what a stage finds now."""
        return find()


class Checkpoints:
    """One file a stage.

    Args:
        folder: where they are.
        seconds: seconds by stage; of one that is read back, those that it took when it ran.

    Attributes:
        earlier: seconds that the stages took which were read back, in the attempts that ran them.
    """

    def __init__(self, folder: Path, seconds: dict[str, float]) -> None:
        self.folder, self.seconds = folder, seconds
        self.earlier = 0.0

    def stage(self, name: str, find: Callable[[], Found]) -> Found:
        """Return what a stage found: in the attempt that was cut short, or else now."""
        path = self.folder / f"{name}.pt"
        kept, code = _read(path), git_commit()
        # Records of other code may lack what this one reads, and findings are of one code.
        if kept is not None and kept.get("code") == code:
            self.seconds |= kept["seconds"]
            self.earlier += kept["took"]
            say(f"  {name:<28} found before the interruption")
            return _restored(kept["found"])
        before, began = dict(self.seconds), time.perf_counter()
        found = find()
        took = time.perf_counter() - began
        mine = {title: s for title, s in self.seconds.items() if before.get(title) != s}
        kept = {"found": _plain(found), "seconds": mine, "took": took, "code": code}
        _write(path, kept)
        return found


def _plain(found: Any) -> Any:
    if isinstance(found, tuple):
        return tuple(map(_plain, found))
    return KeptNetwork.of(found) if isinstance(found, Learned) else found


def _restored(kept: Any) -> Any:
    if isinstance(kept, tuple):
        return tuple(map(_restored, kept))
    return kept.restored() if isinstance(kept, KeptNetwork) else kept


def _write(path: Path, kept: dict[str, Any]) -> None:
    # Of a full disk torch tells in words of its own; of its bytes the system tells.
    made = BytesIO()
    torch.save(kept, made)
    with atomic_file(path) as partial:
        partial.write_bytes(made.getvalue())


def _read(path: Path) -> dict[str, Any] | None:
    """Return what a file holds; None where there is none that can be read."""
    if not path.is_file():
        return None
    with torch.serialization.safe_globals([*RECORDS, *ARRAYS]):
        try:
            return torch.load(path, map_location="cpu", weights_only=True)
        except UNREADABLE:
            return None
