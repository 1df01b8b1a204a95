"""The members of an ensemble in a Zarr store, which an interrupted run continues.

A folder holds the states, ``states.zarr``, and the list of the batches of members that are written
completely, ``batches.json``. The list is written atomically after the states of a batch. A batch
that is not on it is simulated again.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.core.files.atomic import write_text_atomic
from dashred.core.files.damaged_files import reading_errors

STATES, BATCHES = "states.zarr", "batches.json"
# Bytes of a chunk: it is read as a whole, and a single state is read where only one is needed.
CHUNK_BYTES = 2**22
DAMAGED = "delete this folder, and start the run again"


def samples_per_chunk(state: int, samples: int) -> int:
    """Return the number of samples in a chunk, for states of so many bytes."""
    return max(1, min(samples, CHUNK_BYTES // state))


class EnsembleStore:
    """Trajectories in a folder: ``(slot, time, field, *grid)``, float64.

    Attributes:
        folder: of the store.
        batches: for each completed batch, whether each of its members is kept.

    Args:
        folder: it need not exist.
        identity: text that differs if the members differ. A store with another one is replaced.
        shape: ``(slot, time, field, *grid)``.
    """

    def __init__(self, folder: Path, identity: str, shape: tuple[int, ...]) -> None:
        self.folder, self.identity = folder, identity
        self.shape = shape
        state = 8 * int(np.prod(shape[2:]))
        self.chunk = samples_per_chunk(state, shape[1])
        known = _batches(folder, identity)
        if known is None:
            shutil.rmtree(folder, ignore_errors=True)
        self.batches = known or []
        folder.mkdir(parents=True, exist_ok=True)
        self._array = _open_array(folder / STATES, shape, self.chunk)
        if known is None:
            self._write_batches()

    def write(self, slots: Sequence[int], first: int, states: Tensor) -> None:
        """Write samples of some members; whole chunks, unless the last.

        Args:
            slots: place of each member.
            first: first of the samples.
            states: ``(member, time, field, *grid)``.
        """
        for slot, own in zip(slots, states.numpy(), strict=True):
            self._array[slot, first : first + len(own)] = own

    def complete_batch(self, kept: Sequence[bool]) -> None:
        """Record that a batch is written, and which of its members are kept."""
        self.batches.append(list(kept))
        self._write_batches()

    def read(self, member: int, first: int, end: int) -> Tensor:
        """See :meth:`.stored_states.StateReader.read`; ``member`` is a slot."""
        with reading_errors("store of simulations", str(self.folder), DAMAGED):
            values = np.asarray(self._array[member, first:end])
        # A chunk without a file is read as NaN, and no simulation that is kept has one.
        if np.isnan(values.reshape(len(values), -1)[:, 0]).any():
            what = f"samples {first} to {end - 1} of member {member} are missing in this store"
            raise InputError(what, where=str(self.folder), hint=DAMAGED)
        return torch.from_numpy(values)

    def _write_batches(self) -> None:
        content = {"identity": self.identity, "kept": self.batches}
        write_text_atomic(self.folder / BATCHES, json.dumps(content))


def _batches(folder: Path, identity: str) -> list[list[bool]] | None:
    """Return the completed batches of a store; None if there is none of this identity."""
    try:
        content = json.loads((folder / BATCHES).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(content, dict) or content.get("identity") != identity:
        return None
    return list(content["kept"])


def _open_array(path: Path, shape: tuple[int, ...], chunk: int) -> Any:
    # Imported here, because it takes half a second and few runs need it.
    import zarr

    if path.is_dir():
        with reading_errors("store of simulations", str(path), DAMAGED):
            return zarr.open_array(path, mode="r+")
    # The values are all but random: a compressor would take longer than the disk, for a tenth.
    return zarr.create_array(
        path,
        shape=shape,
        chunks=(1, chunk, *shape[2:]),
        dtype="float64",
        compressors=None,
        fill_value=np.nan,
    )
