"""What the simulator forecasts over a step, and what each candidate term would change in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.physics.algebra import Expr, names
from dashred.physics.forcing import Forcing
from dashred.physics.library import resolve
from dashred.physics.simulate import simulate
from dashred.physics.system import System, Term

RELATIVE_STEP = 1e-3


@dataclass(frozen=True)
class Step:
    """Steps of one length through a reconstructed field.

    Attributes:
        begins, ends: time indices, ``(begin,)``.
        time: clock time of the first begin.
        forecast: ``Φ_Δt(û_begin)``, ``(begin, field, *grid)``.
    """

    begins: Tensor
    ends: Tensor
    time: float
    forecast: Tensor


@torch.no_grad()
def forecast_steps(
    system: System, fields: Tensor, times: Tensor, begins: Tensor, stride: int
) -> Step:
    """Run the simulator for one step of ``stride`` samples from each reconstructed field.

    Args:
        system: the simulator.
        fields: û, ``(time, field, *grid)``, float64.
        times: clock, ``(time,)``, uniform.
        begins: time indices to start from, ``(begin,)``.
        stride: length of the step, in samples.
    """
    forecasts = [
        simulate(system, fields[group], _window(times, group, stride))[:, -1]
        for group in _groups(list(system.resolved.values()), begins)
    ]
    return Step(begins, begins + stride, float(times[begins[0]]), torch.cat(forecasts))


@torch.no_grad()
def tangents(
    system: System,
    library: Sequence[Term],
    scales: Tensor,
    fields: Tensor,
    times: Tensor,
    step: Step,
) -> Tensor:
    """Return ``∂Φ_Δt(û_begin)/∂ξ_j``, ``(begin, term, field, *grid)``, by forward differences.

    The paper perturbs by ``θ_j Δt`` at one instant. A front moves several grid cells within a
    sample, so the term is carried along by the simulator instead: ``w' = N'(u)w + θ_j(u)``,
    which has the paper's column as its limit for ``Δt → 0``.

    Args:
        system: the simulator.
        library: the candidates.
        scales: coefficient of each at which it would equal the whole tendency, ``(term,)``.
        fields: û, ``(time, field, *grid)``, float64.
        times: clock, ``(time,)``, uniform.
        step: begins, ends and plain forecasts.
    """
    terms = resolve(system, library)
    size = RELATIVE_STEP * scales
    stride = int(step.ends[0] - step.begins[0])
    found = []
    read = [*system.resolved.values(), *(term.expression for term in terms)]
    for group in _groups(read, step.begins):
        starts = fields[group].repeat_interleave(len(terms), dim=0)
        forcing = Forcing(terms, torch.diag(size).repeat(len(group), 1))
        moved = simulate(system, starts, _window(times, group, stride), forcing)[:, -1]
        found.append(moved.reshape(len(group), len(terms), *fields.shape[1:]))
    steps = size.reshape(-1, *(1,) * (fields.dim() - 1))
    return (torch.cat(found) - step.forecast[:, None]) / steps


def _groups(read: Sequence[Expr], begins: Tensor) -> tuple[Tensor, ...]:
    """Return begins that may share a clock: all of them, unless an expression reads ``t``."""
    reads_time = any("t" in names(expression) for expression in read)
    return begins.split(1 if reads_time else len(begins))


def _window(times: Tensor, group: Tensor, stride: int) -> Tensor:
    return times[[int(group[0]), int(group[0]) + stride]]
