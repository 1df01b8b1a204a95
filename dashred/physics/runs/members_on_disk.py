"""Random members of an ensemble that are simulated in batches and written to disk."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.core.threads import thread_count
from dashred.physics.runs.ensemble import Ensemble, MemberSource, bounds, stays_inside
from dashred.physics.runs.ensemble_store import EnsembleStore, samples_per_chunk
from dashred.physics.runs.rounds import draw_until_enough
from dashred.physics.runs.stored_states import StoredStates
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import Progress, simulate

# Bytes of the trajectories that are simulated together, and the number of their copies meanwhile.
WORK_BYTES, COPIES = 2**29, 3


class BatchSize(NamedTuple):
    """Number of members that are simulated together, and of samples that are written together."""

    members: int
    samples: int

    @classmethod
    def of(cls, members: int, samples: int, state: int) -> BatchSize:
        """Return the size for an ensemble whose states have so many bytes."""
        whole = COPIES * state * samples
        together = min(members, max(thread_count(), WORK_BYTES // whole))
        if together * whole <= WORK_BYTES:
            return cls(together, samples)
        chunk = samples_per_chunk(state, samples)
        chunks = WORK_BYTES // (COPIES * state * together * chunk)
        # At least two: a simulation has a first and a last sample.
        return cls(together, min(samples, max(2, chunk * max(1, chunks))))


def draw_ensemble_to_disk(source: MemberSource, members: int, folder: Path, run: str) -> Ensemble:
    """Simulate the members of :func:`.ensemble.draw_ensemble` and write them to a Zarr store.

    Every trajectory is the same up to rounding errors. Adaptive methods choose their steps for a
    whole batch, so there it is the same up to their tolerance. If the folder holds the first
    batches of the same ensemble, they are not simulated again.

    Args:
        source: what members are drawn from.
        members: number of trajectories.
        folder: of the store.
        run: text that tells the input and the code of this run from others.

    Raises:
        InputError: too few members stay bounded, or the disk has too little space.
        OutOfTimeError: see :func:`.ensemble.draw_ensemble`.
    """
    samples, state = len(source.times), source.nominal.shape[1:]
    size = BatchSize.of(members, samples, 8 * math.prod(state))
    # The members of a batch that do not stay within bounds are overwritten by the next one.
    shape = (members + size.members, samples, *state)
    store = EnsembleStore(folder, _identity(source, members, run, size), shape)
    found = MembersOnDisk(source, store, size)
    draw_until_enough(found, members, source.system)
    return Ensemble(source.times, StoredStates(store, found.slots), torch.cat(found.coefficients))


@dataclass
class MembersOnDisk:
    """Members (:class:`.rounds.Members`) in a store.

    Attributes:
        source: what members are drawn from.
        store: for the trajectories.
        size: of a batch.
        slots: place of each member in the store.
        coefficients: of the members of each batch, ``(member, term)``.
        done: number of batches.
    """

    source: MemberSource
    store: EnsembleStore
    size: BatchSize
    slots: list[int] = field(default_factory=list)
    coefficients: list[Tensor] = field(default_factory=list)
    done: int = 0

    @property
    def count(self) -> int:
        """Number of members."""
        return len(self.slots)

    def draw(self, missing: int, rounds_left: float) -> None:
        """See :meth:`.rounds.Members.draw`. All random numbers are drawn before the first batch."""
        source = self.source
        z = torch.from_numpy(source.rng.standard_normal((missing, source.prior.size)))
        drawn = source.forcing(missing)
        for first in range(0, missing, self.size.members):
            rows = slice(first, min(first + self.size.members, missing))
            forcing = Forcing(drawn.terms, drawn.coefficients[rows])
            slots = self._free_slots(rows.stop - rows.start)
            if self.done == len(self.store.batches):
                repeats = rounds_left * missing / (rows.stop - rows.start)
                inside = self._simulate(
                    z[rows], forcing, slots, repeats, self._progress_of(rows, missing)
                )
                self.store.complete_batch(inside.tolist())
            kept = self.store.batches[self.done]
            self.done += 1
            self.slots += [slot for slot, is_kept in zip(slots, kept, strict=True) if is_kept]
            self.coefficients.append(forcing.coefficients[torch.tensor(kept)])

    def _free_slots(self, count: int) -> list[int]:
        used = set(self.slots)
        return [slot for slot in range(self.store.shape[0]) if slot not in used][:count]

    def _progress_of(self, rows: slice, missing: int) -> Progress:
        def progress(done: float) -> None:
            if self.source.progress is not None:
                self.source.progress((rows.start + done * (rows.stop - rows.start)) / missing)

        return progress

    def _simulate(
        self, z: Tensor, forcing: Forcing, slots: list[int], repeats: float, progress: Progress
    ) -> Tensor:
        """Simulate a batch and write it; return which members stay within bounds, ``(member,)``."""
        source, times = self.source, self.source.times
        states = source.prior.start(z)
        low, high = bounds(source.nominal, states)
        rows = torch.arange(len(z))
        last = max(1, len(times) - 1)
        # Samples [first, end) are written together. The simulation starts from the sample before.
        for first in range(0, len(times), self.size.samples):
            end, before = min(first + self.size.samples, len(times)), max(0, first - 1)
            clock = times[before:end]
            law = Forcing(forcing.terms, forcing.coefficients[rows])
            share = (end - 1 - before) / last
            found = simulate(
                source.system,
                states,
                clock,
                law,
                _part_of(progress, before / last, share),
                repeats=repeats / share,
            )
            inside = stays_inside(found, low[rows], high[rows])
            rows, found = rows[inside], found[inside]
            if not len(rows):
                break
            states = found[:, -1]
            self.store.write(
                [slots[row] for row in rows.tolist()], first, found[:, first - before :]
            )
        return torch.isin(torch.arange(len(z)), rows)


def _part_of(progress: Progress, begin: float, share: float) -> Callable[[float], None]:
    return lambda done: progress(begin + share * done)


def _identity(source: MemberSource, members: int, run: str, size: BatchSize) -> str:
    """Return a text that differs if anything differs that determines the members."""
    digest, system, prior = hashlib.sha256(), source.system, source.prior
    for tensor in (source.times, prior.start(torch.ones((1, prior.size)).double()), source.nominal):
        digest.update(tensor.contiguous().numpy().data)
    terms = None if source.errors is None else source.errors.identity
    described = [
        *map(str, (system.equations, system.config, system.dt)),
        source.rng.bit_generator.state,
        terms,
        members,
        size,
        run,
    ]
    digest.update(json.dumps(described, sort_keys=True, default=str).encode())
    return digest.hexdigest()
