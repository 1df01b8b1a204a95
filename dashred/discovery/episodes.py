"""Shooting over several episodes at once: a start and a clock of its own for each, one law for all.

Sample k of every episode stands beside sample k of the others, so a horizon grows in all at once::

    times     (time, episode)
    states    (batch, time, episode, field, *grid)
    readings  (batch, time, episode·sensor)

An episode that has ended stands still, its clock and its state, and nothing is recorded there. Of
one episode alone everything is as it is without this module: it has no such dimension.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.discovery.candidates import Candidate
from dashred.discovery.shooting import Simulator
from dashred.discovery.starts import StartModel
from dashred.physics.forcing import Forcing
from dashred.physics.pulses import Drive, Pulses
from dashred.physics.system import Term
from dashred.physics.window import Window
from dashred.sensing.observation import ObservationOperator


def clocks(times: Sequence[Tensor]) -> Tensor:
    """Return the clocks of episodes side by side, ``(time, episode)``; of one, its ``(time,)``."""
    if len(times) == 1:
        return times[0]
    longest = max(map(len, times))
    held = [torch.cat([t, t[-1:].expand(longest - len(t))]) for t in times]
    return torch.stack(held, dim=1)


def running(clock: Tensor) -> Tensor:
    """Return an episode's clock until it stands still."""
    return clock[: 1 + int((clock[1:] > clock[:-1]).sum())]


def side_by_side(values: Sequence[Tensor]) -> Tensor:
    """Return what episodes ``(time, sensor)`` recorded as ``(time, episode·sensor)``, else NaN."""
    if len(values) == 1:
        return values[0]
    longest = max(map(len, values))
    padded = [
        torch.cat([v, v.new_full((longest - len(v), *v.shape[1:]), torch.nan)]) for v in values
    ]
    return torch.cat(padded, dim=1)


@dataclass(frozen=True)
class EpisodeStarts:
    """``u₀ = (start_1(z_1), …, start_E(z_E))``, z in blocks."""

    models: tuple[StartModel, ...]

    @property
    def size(self) -> int:
        """Number of independent standard normals z."""
        return sum(model.size for model in self.models)

    def start(self, z: Tensor) -> Tensor:
        """Return the starts ``(batch, episode, field, *grid)`` of ``z``, ``(batch, size)``."""
        blocks = z.split([model.size for model in self.models], dim=1)
        starts = [m.start(block) for m, block in zip(self.models, blocks, strict=True)]
        return torch.stack(starts, dim=1)


def starts_of(models: Sequence[StartModel]) -> StartModel:
    """Return the start of all episodes; of one, its own."""
    return models[0] if len(models) == 1 else EpisodeStarts(tuple(models))


class EpisodesOperator(ObservationOperator):
    """H of every episode: the same sensors, their columns side by side."""

    def __init__(self, operator: ObservationOperator, episodes: int) -> None:
        torch.nn.Module.__init__(self)
        self.operator = operator
        self.sensors = operator.sensors * episodes

    def forward(self, state: Tensor, t: float = 0.0) -> Tensor:
        """Read states ``(*batch, episode, field, *grid)``: ``(*batch, episode·sensor)``."""
        return self.operator(state, t).flatten(-2)


def operator_of(operator: ObservationOperator, episodes: int) -> ObservationOperator:
    """Return H of so many episodes; of one, its own."""
    return operator if episodes == 1 else EpisodesOperator(operator, episodes)


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
        drive: Drive | None = None,
    ) -> Tensor:
        """Return trajectories ``(batch, time, episode, field, *grid)``."""

        def march(part: Simulator, begin: Tensor, clock: Tensor, n: int) -> Tensor:
            return part.run(begin, clock, candidates, _rows(xi, n), _driven(drive, n))

        return self._march(start, times, march)

    def run_local(
        self,
        start: Tensor,
        times: Tensor,
        candidates: Sequence[Candidate],
        everywhere: Tensor,
        inside: Tensor,
        windows: Sequence[Window],
        drive: Drive | None = None,
    ) -> Tensor:
        """Return trajectories ``(batch, time, episode, field, *grid)``; windows are common."""

        def march(part: Simulator, begin: Tensor, clock: Tensor, n: int) -> Tensor:
            own = [window for window in windows for _ in range(n)]
            rows = _rows(everywhere, n), _rows(inside, n)
            return part.run_local(begin, clock, candidates, *rows, own, _driven(drive, n))

        return self._march(start, times, march)

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        times: Tensor,
        forcing: Forcing,
        sources: Sequence[tuple[Term, ...]],
        drive: Drive | None,
        pulses: Pulses | None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield states ``(episode, field, *grid)`` and tangents ``(column, episode, …)``."""
        each = [
            _tangents(
                part, start[e], directions[:, e], times[:, e], forcing, sources, drive, pulses
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


def one_after_another(values: Tensor, times: Tensor) -> Tensor:
    """Return samples ``(time, episode, …)`` episode by episode, without those after its end.

    Args:
        values: of every sample.
        times: ``(time, episode)``; of one episode ``(time,)``, and then the values are as they are.
    """
    if times.dim() == 1:
        return values
    ends = [len(running(clock)) for clock in times.T]
    return torch.cat([values[:end, e] for e, end in enumerate(ends)])


def _rows(values: Tensor, episodes: int) -> Tensor:
    return values.repeat_interleave(episodes, dim=0)


def _driven(drive: Drive | None, episodes: int) -> Drive | None:
    return drive and Drive(drive.knots, _rows(drive.values, episodes))


def _tangents(
    part: Simulator,
    start: Tensor,
    directions: Tensor,
    clock: Tensor,
    forcing: Forcing,
    sources: Sequence[tuple[Term, ...]],
    drive: Drive | None,
    pulses: Pulses | None,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield one episode's state and tangents: nothing moves by the starts of the others."""
    mine, own = directions.flatten(1).any(dim=1), running(clock)
    count, moved = len(directions), int(mine.sum())
    base = start, directions[mine], own, forcing, sources, drive, pulses
    for state, columns in part.tangents(*base):
        whole = columns.new_zeros((count + len(columns) - moved, *columns.shape[1:]))
        whole[:count][mine], whole[count:] = columns[:moved], columns[moved:]
        yield state, whole
    for _ in range(len(clock) - len(own)):
        yield state, torch.zeros_like(whole)
