"""What the simulator forecasts over a step, and what each candidate term would change in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from dashred.physics.expressions.algebra import Expr, names
from dashred.physics.library import resolve
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term

RELATIVE_STEP = 1e-3


@dataclass(frozen=True)
class Step:
    """Steps of one length through a reconstructed field.

    Attributes:
        begins, ends: time indices, ``(begin,)``.
        time: clock time of the first begin.
        path: the simulator's run from each ``û_begin``, sample by sample,
            ``(begin, sample, field, *grid)``.
    """

    begins: Tensor
    ends: Tensor
    time: float
    path: Tensor

    @property
    def forecast(self) -> Tensor:
        """``Φ_Δt(û_begin)``, ``(begin, field, *grid)``."""
        return self.path[:, -1]


class Steps(Protocol):
    """What the simulator forecasts over steps, and what each candidate would change in that."""

    def forecasts(
        self, fields: Tensor, times: Tensor, begins: Tensor, strides: Sequence[int]
    ) -> list[Step]:
        """Return forecasts from the begins, one entry a step length; see :func:`forecast_steps`."""

    def columns(self, fields: Tensor, times: Tensor, steps: Sequence[Step]) -> list[Tensor]:
        """Return what each term adds, ``(begin, term, field, *grid)`` by step length."""


@dataclass(frozen=True)
class SimulatorSteps:
    """Steps of a simulator that can be run.

    Attributes:
        system: the simulator.
        library: the candidates.
        scales: coefficient of each at which it would equal the whole tendency, ``(term,)``.
    """

    system: System
    library: Sequence[Term]
    scales: Tensor

    def forecasts(
        self, fields: Tensor, times: Tensor, begins: Tensor, strides: Sequence[int]
    ) -> list[Step]:
        """Run the simulator; see :func:`forecast_steps`."""
        return forecast_steps(self.system, fields, times, begins, strides)

    def columns(self, fields: Tensor, times: Tensor, steps: Sequence[Step]) -> list[Tensor]:
        """Carry each term along with the simulator; see :func:`tangents`."""
        return tangents(self.system, self.library, self.scales, fields, times, steps)


@torch.no_grad()
def forecast_steps(
    system: System, fields: Tensor, times: Tensor, begins: Tensor, strides: Sequence[int]
) -> list[Step]:
    """Run the simulator from each reconstructed field; one entry a step length.

    Args:
        system: the simulator.
        fields: û, ``(time, field, *grid)``, float64.
        times: clock, ``(time,)``, uniform.
        begins: time indices to start from, ``(begin,)``; all lengths share them and one run.
        strides: lengths of the steps, in samples.
    """
    longest = max(strides)
    path = torch.cat(
        [
            simulate(system, fields[group], times[int(group[0]) : int(group[0]) + longest + 1])
            for group in _groups(list(system.resolved.values()), system.clock, begins)
        ]
    )
    time = float(times[begins[0]])
    return [Step(begins, begins + n, time, path[:, : n + 1]) for n in strides]


@torch.no_grad()
def tangents(
    system: System,
    library: Sequence[Term],
    scales: Tensor,
    fields: Tensor,
    times: Tensor,
    steps: Sequence[Step],
) -> list[Tensor]:
    """Return what each term would add to each forecast, ``(begin, term, field, *grid)``, by step.

    The paper perturbs by ``θ_j Δt`` at one instant. A front moves several grid cells within a
    sample, so the term is carried along by the simulator instead: ``w' = N'(m)w + θ_j(m)``,
    which has the paper's column as its limit for ``Δt → 0``. At every sample the tangent is taken
    anew about ``m = (û + forecast)/2``: ``N(û) - N(forecast) = N'(m)(û - forecast)`` holds to
    third order, and a front's response is far from linear after a few samples.

    Args:
        system: the simulator.
        library: the candidates.
        scales: coefficient of each at which it would equal the whole tendency, ``(term,)``.
        fields: û, ``(time, field, *grid)``, float64.
        times: clock, ``(time,)``, uniform.
        steps: forecasts of all lengths, from the same begins.
    """
    terms = resolve(system, library)
    read = [*system.resolved.values(), *(term.expression for term in terms)]
    longest = max(steps, key=lambda step: step.path.shape[1])
    marches = [
        _march(system, terms, scales, fields, times, group, path)
        for group, path in zip(
            _groups(read, system.clock, longest.begins),
            _groups(read, system.clock, longest.path),
            strict=True,
        )
    ]
    columns = [torch.cat(samples) for samples in zip(*marches, strict=True)]
    return [columns[step.path.shape[1] - 2] for step in steps]


def _march(
    system: System,
    terms: tuple[Term, ...],
    scales: Tensor,
    fields: Tensor,
    times: Tensor,
    begins: Tensor,
    path: Tensor,
) -> list[Tensor]:
    """Return the tangents after each sample, by forward differences."""
    size = RELATIVE_STEP * scales
    shape = (len(begins), len(terms), *fields.shape[1:])
    h = size.reshape(-1, *(1,) * (fields.dim() - 1))
    forcing = Forcing(terms, torch.diag(size).repeat(len(begins), 1))
    tangent, found = fields.new_zeros(shape), []
    for sample in range(path.shape[1] - 1):
        middle = (fields[begins + sample] + path[:, sample]) / 2
        first = int(begins[0]) + sample
        window = times[first : first + 2]
        starts = (middle[:, None] + h * tangent).flatten(0, 1)
        moved = simulate(system, starts, window, forcing)[:, -1].reshape(shape)
        tangent = (moved - simulate(system, middle, window)[:, -1][:, None]) / h
        found.append(tangent)
    return found


def _groups(read: Sequence[Expr], clock: frozenset[str], values: Tensor) -> tuple[Tensor, ...]:
    """Split by begin what may not share a clock: everything, if an expression reads the time."""
    reads_time = any(clock & names(expression) for expression in read)
    return values.split(1 if reads_time else len(values))
