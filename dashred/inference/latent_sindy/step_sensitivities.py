"""Forecasts of the simulator over a step, and their derivatives by the candidate terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.terms.library import resolve

# Step of a finite difference, as a share of the scale of a coefficient or of the std of a reading.
RELATIVE_STEP = 1e-3


@dataclass(frozen=True)
class Step:
    """Steps of one length through a reconstructed field.

    Attributes:
        begins, ends: time indices, ``(begin,)``.
        time: time of the first begin.
        path: run of the simulator from each ``û_begin``, sample by sample,
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
    """Forecasts over steps, and their derivatives by the candidate coefficients."""

    def forecasts(
        self, fields: Tensor, times: Tensor, begins: Tensor, strides: Sequence[int]
    ) -> list[Step]:
        """Return one forecast for each step length; see :func:`forecast_steps`."""

    def columns(self, fields: Tensor, times: Tensor, steps: Sequence[Step]) -> list[Tensor]:
        """Return derivatives ``(begin, term, field, *grid)``, one entry for each step length."""


@dataclass(frozen=True)
class SimulatorSteps:
    """Steps of a simulator with equations.

    Attributes:
        system: the simulator.
        library: the candidates.
        scales: coefficients at which each term would be as large as the tendency, ``(term,)``.
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
        """Propagate each term with the simulator; see :func:`tangents`."""
        return tangents(self.system, self.library, self.scales, fields, times, steps)


@torch.no_grad()
def forecast_steps(
    system: System, fields: Tensor, times: Tensor, begins: Tensor, strides: Sequence[int]
) -> list[Step]:
    """Run the simulator from each reconstructed field; one entry for each step length.

    Args:
        system: the simulator.
        fields: û, ``(time, field, *grid)``, float64.
        times: uniform times, ``(time,)``.
        begins: time indices of the initial fields, ``(begin,)``; all lengths share one run.
        strides: lengths of the steps, in samples.
    """
    longest = max(strides)
    path = torch.cat(
        [
            simulate(system, fields[group], times[int(group[0]) : int(group[0]) + longest + 1])
            for group in _groups(system.reads_time(), begins)
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
    """Return the derivatives of each forecast by each coefficient, one entry for each step length.

    Each entry is ``(begin, term, field, *grid)``. The paper perturbs by ``θ_j Δt`` at one time. But
    a front moves several grid cells within a sample. The term is therefore propagated with the
    simulator, ``w' = N'(m)w + θ_j(m)``; the column of the paper is the limit ``Δt → 0``. At every
    sample the tangent is linearised again at ``m = (û + forecast)/2``, because
    ``N(û) - N(forecast) = N'(m)(û - forecast)`` holds to third order there, and the response of a
    front is far from linear after a few samples.

    Args:
        system: the simulator.
        library: the candidates.
        scales: coefficients at which each term would be as large as the tendency, ``(term,)``.
        fields: û, ``(time, field, *grid)``, float64.
        times: uniform times, ``(time,)``.
        steps: forecasts of all lengths, from the same begins.
    """
    terms = resolve(system, library)
    reads_time = system.reads_time(*(term.expression for term in terms))
    longest = max(steps, key=lambda step: step.path.shape[1])
    marches = [
        _march(system, terms, scales, fields, times, group, path)
        for group, path in zip(
            _groups(reads_time, longest.begins),
            _groups(reads_time, longest.path),
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


def _groups(reads_time: bool, values: Tensor) -> tuple[Tensor, ...]:
    """Split values by begin if the equations depend on time; otherwise return one group."""
    return values.split(1 if reads_time else len(values))
