"""The simulator of all episodes: one trajectory for each, under one law.

Every array has an episode axis; a single recording is one episode::

    times     (time, episode)
    states    (batch, time, episode, field, *grid)

After the last sample of an episode its time and its state are repeated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import torch
from torch import Tensor

from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.episodes import without_padding
from dashred.inference.forward.parameter_block import NO_PARAMETERS, ParameterBlock
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import Term
from dashred.physics.window import Window

# Number of derivatives in a block: smaller blocks cost more in calls than in arithmetic.
BLOCK_SIZE = 2**16
ALL = slice(0, None)
Samples = Iterator[tuple[Tensor, Tensor]]


class Simulator:
    """The simulators of all episodes, each a :class:`CandidateSimulator`.

    Episodes without inputs share one simulator. Episodes with the same simulator and the same times
    are integrated in one batch.

    Attributes:
        parts: the simulator of each episode.
        system: the system of the first episode; the others differ only in their inputs.
        tangent: the same system with the time step of the derivative.
        shapes: shapes of the windows in which candidates may act.
        parameters: uncertain parameters, which are candidates of every part.
        has_tangents: whether tangent-linear equations exist for all episodes.
        has_chunks: whether some columns can be had without the others, in all episodes.
    """

    def __init__(
        self, parts: Sequence[CandidateSimulator], parameters: ParameterBlock = NO_PARAMETERS
    ) -> None:
        self.parts, first = tuple(parts), parts[0]
        self.parameters = parameters
        self.system, self.tangent, self.shapes = first.system, first.tangent, first.shapes
        self.has_tangents = all(part.has_tangents for part in parts)
        self.has_chunks = all(part.has_chunks for part in parts)

    @property
    def values(self) -> int:
        """Number of values of the state of an episode."""
        return len(self.system.fields) * math.prod(self.system.grid.shape)

    def has_compiled(self, candidates: Sequence[Candidate]) -> bool:
        """Return whether compiled code integrates trajectories with these candidates."""
        return all(part.has_compiled(candidates) for part in self.parts)

    def coarse(self) -> Simulator:
        """Return the simulators with the time step of the derivative for trajectories, too."""
        return self._each(CandidateSimulator.coarse)

    def finer(self) -> Simulator:
        """Return the simulators with the time step of the system for derivatives, too."""
        return self._each(CandidateSimulator.finer)

    def with_candidates(self, candidates: Sequence[Candidate]) -> Simulator:
        """Return the simulators with other candidates, without windows."""
        whole = [*self.parameters.candidates, *candidates]
        return self._each(lambda part: part.with_candidates(whole))

    def weights(
        self,
        candidates: Sequence[Candidate],
        xi: Tensor,
        windowed: Tensor | None = None,
        windows: Sequence[Window] = (),
    ) -> Tensor:
        """Return the weights of trajectories; see :meth:`CandidateSimulator.weights`."""
        return self.parts[0].weights(candidates, xi, windowed, windows)

    def run(
        self, start: Tensor, times: Tensor, weights: Tensor, forcing: SampledForcing | None = None
    ) -> Tensor:
        """Return trajectories ``(batch, time, episode, field, *grid)``.

        Args:
            start: ``(batch, episode, field, *grid)``.
            times: ``(time, episode)``.
            weights: ``(batch, weight)``, the same in all episodes.
            forcing: forcing of each row of the batch, the same in all episodes; None without one.
        """
        states = start.new_empty((len(start), len(times), *start.shape[1:]))
        for group in self._groups(times):
            clock, count = without_padding(times[:, group[0]]), len(group)
            rows = weights.repeat_interleave(count, dim=0)
            force = forcing and SampledForcing(
                forcing.knots, forcing.values.repeat_interleave(count, dim=0)
            )
            begin = start[:, group].flatten(0, 1)
            found = self.parts[group[0]].run(begin, clock, rows, force)
            for i, episode in enumerate(group):
                states[:, : len(clock), episode] = found[i::count]
                states[:, len(clock) :, episode] = found[i::count, -1:]
        return states

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        times: Tensor,
        forcing: Forcing,
        sources: Sequence[tuple[Term, ...]],
        sampled_forcing: SampledForcing | None,
        forcing_basis: ForcingBasis | None,
        weights: Tensor | None,
        chosen: slice = ALL,
    ) -> Samples:
        """Yield states and their derivatives in blocks of samples.

        States are ``(sample, episode, field, *grid)``, and derivatives are
        ``(sample, column, episode, field, *grid)``.
        Directions that are zero in an episode are not integrated there.

        Args:
            start: ``(episode, field, *grid)``.
            directions: derivatives of the start, ``(direction, episode, field, *grid)``.
            times: ``(time, episode)``.
            forcing: the law, one row.
            sources: terms; a column is the derivative by the coefficient of one entry.
            sampled_forcing: the free forcing, one row; None without one.
            forcing_basis: basis of the free forcing; the last columns are derivatives by its
                amplitudes.
            weights: weights of the law, ``(1, weight)``, for a compiled trajectory; None for one
                that is not compiled.
            chosen: the columns that are wanted; all of them without :attr:`has_chunks`.
        """
        moving = directions.flatten(2).any(dim=2)
        others = len(sources) + (forcing_basis.count if forcing_basis else 0)
        shared = forcing, sources, sampled_forcing, forcing_basis, weights
        each = []
        for e, part in enumerate(self.parts):
            own, moved = without_padding(times[:, e]), moving[:, e]
            integrated = torch.cat([moved, moved.new_ones(others)])
            wanted, before = integrated[chosen], int(integrated[: chosen.start].sum())
            mine = range(before, before + int(wanted.sum()))
            samples = part.tangents(start[e], directions[moved, e], own, *shared, mine)
            each.append(_blocks(_pad_samples(samples, len(times) - len(own)), wanted))
        for blocks in zip(*each, strict=True):
            states, columns = zip(*blocks, strict=True)
            if len(blocks) == 1:  # A view: the columns of a plane are large.
                yield states[0].unsqueeze(1), columns[0].unsqueeze(2)
            else:
                yield torch.stack(states, dim=1), torch.stack(columns, dim=2)

    def _each(self, change: Callable[[CandidateSimulator], CandidateSimulator]) -> Simulator:
        changed = {part: change(part) for part in dict.fromkeys(self.parts)}
        return Simulator([changed[part] for part in self.parts], self.parameters)

    def _groups(self, times: Tensor) -> list[list[int]]:
        """Return groups of episodes with the same simulator and the same times."""
        found: dict[tuple[CandidateSimulator, tuple[float, ...]], list[int]] = {}
        for e, (part, clock) in enumerate(zip(self.parts, times.T.tolist(), strict=True)):
            found.setdefault((part, tuple(clock)), []).append(e)
        return list(found.values())


def _pad_samples(samples: Samples, further: int) -> Samples:
    """Yield the samples of an episode, then its last state with zero columns as padding."""
    for state, columns in samples:
        yield state, columns
    for _ in range(further):
        yield state, torch.zeros_like(columns)


def _blocks(samples: Samples, integrated: Tensor) -> Samples:
    """Yield samples in blocks, with zero columns for directions that were not integrated.

    Args:
        samples: states and the integrated columns.
        integrated: whether each column was integrated, ``(column,)``.
    """
    states: list[Tensor] = []
    tangents: list[Tensor] = []
    for state, columns in samples:
        states.append(state)
        tangents.append(columns)
        # All episodes have blocks of the same length, whatever directions are integrated there.
        if len(states) * len(integrated) * state.numel() >= BLOCK_SIZE:
            yield torch.stack(states), _stack(tangents, integrated)
            states, tangents = [], []
    if states:
        yield torch.stack(states), _stack(tangents, integrated)


def _stack(columns: Sequence[Tensor], integrated: Tensor) -> Tensor:
    """Return the columns of some samples in double precision, zero if not integrated."""
    shape = len(columns), len(integrated), *columns[0].shape[1:]
    whole = columns[0].new_zeros(shape, dtype=torch.float64)
    chosen = slice(None) if bool(integrated.all()) else integrated
    for sample, found in zip(whole, columns, strict=True):
        sample[chosen] = found.double()
    return whole
