"""The simulator of several episodes at once, each with its own start, clock and inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import torch
from torch import Tensor

from dashred.inference.forward.candidate_simulator import Simulator
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.episodes import one_after_another, running
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import Term
from dashred.physics.window import Window


class EpisodesSimulator(Simulator):
    """A simulator for every episode: one and the same, where no input tells them apart.

    Episodes of one simulator on one clock run as members of one batch.
    """

    def __init__(self, parts: Sequence[Simulator]) -> None:
        self.parts, first = tuple(parts), parts[0]
        self.system, self.tangent, self.shapes = first.system, first.tangent, first.shapes
        self.terms = first.terms
        self.has_tangents = all(part.has_tangents for part in parts)

    def coarse(self) -> Simulator:
        """Return the simulators that take the derivative's steps themselves."""
        return self._each(Simulator.coarse)

    def finer(self) -> Simulator:
        """Return the simulators whose derivatives take their own steps."""
        return self._each(Simulator.finer)

    def of(self, candidates: Sequence[Candidate]) -> Simulator:
        """Return the same with other candidates in reach."""
        return self._each(lambda part: part.of(candidates))

    def run(
        self,
        start: Tensor,
        times: Tensor,
        candidates: Sequence[Candidate],
        xi: Tensor,
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return trajectories ``(batch, time, episode, field, *grid)``."""

        def march(part: Simulator, begin: Tensor, clock: Tensor, n: int) -> Tensor:
            return part.run(begin, clock, candidates, _rows(xi, n), _driven(sampled_forcing, n))

        return self._march(start, times, march)

    def run_local(
        self,
        start: Tensor,
        times: Tensor,
        candidates: Sequence[Candidate],
        everywhere: Tensor,
        inside: Tensor,
        windows: Sequence[Window],
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return trajectories ``(batch, time, episode, field, *grid)``; windows are common."""

        def march(part: Simulator, begin: Tensor, clock: Tensor, n: int) -> Tensor:
            own = [window for window in windows for _ in range(n)]
            rows = _rows(everywhere, n), _rows(inside, n)
            return part.run_local(begin, clock, candidates, *rows, own, _driven(sampled_forcing, n))

        return self._march(start, times, march)

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        times: Tensor,
        forcing: Forcing,
        sources: Sequence[tuple[Term, ...]],
        sampled_forcing: SampledForcing | None,
        forcing_basis: ForcingBasis | None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield states ``(episode, field, *grid)`` and tangents ``(column, episode, …)``."""
        each = [
            _tangents(
                part,
                start[e],
                directions[:, e],
                times[:, e],
                forcing,
                sources,
                sampled_forcing,
                forcing_basis,
            )
            for e, part in enumerate(self.parts)
        ]
        for samples in zip(*each, strict=True):
            states, columns = zip(*samples, strict=True)
            yield torch.stack(states), torch.stack(columns, dim=1)

    def visited(self, states: Tensor, times: Tensor) -> Tensor:
        """Return the states ``(time, episode, field, *grid)`` of one episode after another."""
        return one_after_another(states, times)

    def _each(self, change: Callable[[Simulator], Simulator]) -> EpisodesSimulator:
        changed = {id(part): change(part) for part in self.parts}
        return EpisodesSimulator([changed[id(part)] for part in self.parts])

    def _march(
        self,
        start: Tensor,
        times: Tensor,
        march: Callable[[Simulator, Tensor, Tensor, int], Tensor],
    ) -> Tensor:
        paths: dict[int, Tensor] = {}
        for group in self._groups(times):
            clock = running(times[:, group[0]])
            begin = start[:, group].flatten(0, 1)
            found = march(self.parts[group[0]], begin, clock, len(group))
            found = found.unflatten(0, (len(start), len(group)))
            rest = found[:, :, -1:].repeat_interleave(len(times) - len(clock), dim=2)
            held = torch.cat([found, rest], dim=2)
            paths |= {e: held[:, i] for i, e in enumerate(group)}
        return torch.stack([paths[e] for e in range(len(self.parts))], dim=2)

    def _groups(self, times: Tensor) -> list[list[int]]:
        """Return the episodes that run side by side: of one simulator, on one clock."""
        found: dict[tuple[int, tuple[float, ...]], list[int]] = {}
        for e, part in enumerate(self.parts):
            found.setdefault((id(part), tuple(times[:, e].tolist())), []).append(e)
        return list(found.values())


def simulator_of(parts: Sequence[Simulator]) -> Simulator:
    """Return the simulator of all episodes; of one, its own."""
    return parts[0] if len(parts) == 1 else EpisodesSimulator(parts)


def _rows(values: Tensor, episodes: int) -> Tensor:
    return values.repeat_interleave(episodes, dim=0)


def _driven(sampled_forcing: SampledForcing | None, episodes: int) -> SampledForcing | None:
    return sampled_forcing and SampledForcing(
        sampled_forcing.knots, _rows(sampled_forcing.values, episodes)
    )


def _tangents(
    part: Simulator,
    start: Tensor,
    directions: Tensor,
    clock: Tensor,
    forcing: Forcing,
    sources: Sequence[tuple[Term, ...]],
    sampled_forcing: SampledForcing | None,
    forcing_basis: ForcingBasis | None,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield one episode's state and tangents: nothing moves by the starts of the others."""
    mine, own = directions.flatten(1).any(dim=1), running(clock)
    count, moved = len(directions), int(mine.sum())
    base = start, directions[mine], own, forcing, sources, sampled_forcing, forcing_basis
    for state, columns in part.tangents(*base):
        whole = columns.new_zeros((count + len(columns) - moved, *columns.shape[1:]))
        whole[:count][mine], whole[count:] = columns[:moved], columns[moved:]
        yield state, whole
    for _ in range(len(clock) - len(own)):
        yield state, torch.zeros_like(whole)
