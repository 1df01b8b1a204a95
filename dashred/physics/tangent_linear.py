"""The derivative of a trajectory with respect to its start and to terms of its equations.

``δu' = Lδu + N'(u)δu + θ_k(u)`` is stepped along the stages of one base trajectory. Since ETDRK4
is linear in its stages, the derivative of its step is its step of the linearised tendency: the
columns are exact derivatives of what :func:`dashred.physics.simulate.simulate` computes. (But
for sources linear in their own field: they go through N here, and shift L there.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import islice

import torch
from torch import Tensor

from dashred.physics.algebra import ZERO
from dashred.physics.forcing import Forcing
from dashred.physics.integrators.etdrk4 import ETDRK4, Steppers
from dashred.physics.integrators.schedule import Step, schedule
from dashred.physics.linearisation import NotSeparableError, separate
from dashred.physics.pointwise import Pointwise
from dashred.physics.separated_tendency import Frame, SeparatedTendency
from dashred.physics.sources import Sources
from dashred.physics.system import System, Term
from dashred.physics.value import Value

STAGES = 4
POINTS_AT_ONCE = 2**14
"""Stages times grid points whose coefficients are computed together: they stay in the cache."""
COLUMN_POINTS = 2**16
"""Columns times fields times grid points that are stepped together, for the same reason."""
COMPLEX = {torch.float32: torch.complex64, torch.float64: torch.complex128}


def supports(system: System, terms: Sequence[Term]) -> bool:
    """Tell whether :func:`tangent_linear` can carry these equations, with such a forcing.

    Args:
        system: any system.
        terms: what the forcing may hold, lets and parameters resolved. Sources are free.
    """
    if not system.spectral:
        return False
    axes = [axis.name for axis in system.axes]
    try:
        separate(system.resolved, axes)
        for term in terms:
            separate({**dict.fromkeys(system.fields, ZERO), term.equation: term.expression}, axes)
    except (NotSeparableError, ArithmeticError):
        return False
    return True


@torch.no_grad()
def tangent_linear(
    system: System,
    start: Tensor,
    directions: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    sources: Sequence[tuple[Term, ...]],
    dtype: torch.dtype = torch.float64,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield state and tangents at every output time, the first included.

    Args:
        system: one that :func:`supports` tells yes of.
        start: ``(field, *grid)`` at ``times[0]``, float64.
        directions: ``∂u(0)/∂z``, ``(direction, field, *grid)``.
        times: output times ``(time,)``, as for ``simulate``.
        forcing: one row of further terms, part of the base trajectory and of N'.
        sources: column k is ``∂u(t)/∂ξ`` for ``∂u/∂t = … + ξ Σ_{θ in sources[k]} θ(u)`` at 0;
            lets and parameters resolved.
        dtype: precision of the tangents; the base trajectory is float64 in any case.

    Yields:
        The state ``(field, *grid)``, float64, and the tangents ``(column, field, *grid)``:
        directions first, then sources.

    Raises:
        NotSeparableError: the system is not supported.
    """
    count = len(directions) + len(sources)
    tangents = torch.zeros((count, *start.shape), dtype=dtype, device=start.device)
    tangents[: len(directions)] = directions
    yield start, tangents
    model = _Linearised(system, forcing, sources, len(directions), dtype, start.device)
    size = max(1, COLUMN_POINTS // start.numel())
    chunks = [range(i, min(i + size, count)) for i in range(0, count, size)]
    modes = model.base.frame.in_modes(start.cpu()[:, None])
    columns = [model.frame.in_modes(tangents[c.start : c.stop].transpose(0, 1)) for c in chunks]
    steps_at_once = max(1, POINTS_AT_ONCE // (STAGES * start[0].numel()))
    for steps in _blocks(schedule(times.tolist(), system.dt), steps_at_once):
        modes, states = model.follow(steps, modes)
        found = []
        for i, chunk in enumerate(chunks):
            columns[i], outputs = model.carry(steps, columns[i], chunk)
            found.append(outputs)
        for state, pieces in zip(states, zip(*found, strict=True), strict=True):
            yield (
                state[:, 0].to(start.device),
                torch.cat([piece.transpose(0, 1) for piece in pieces]),
            )


class _Linearised:
    """The equations about a base trajectory, a block of steps at a time."""

    def __init__(
        self,
        system: System,
        forcing: Forcing | None,
        sources: Sequence[tuple[Term, ...]],
        first: int,
        dtype: torch.dtype,
        device: torch.device,
    ) -> None:
        self.system, self.dtype, self.device = system, dtype, device
        self.base = SeparatedTendency(system, forcing)
        self.frame = Frame(system, self.base.parts, COMPLEX[dtype], device)
        self.steppers = Steppers(self.base.linear, self._visit)
        self.sources = Sources(system, sources, first)
        slopes = [
            (channel, self.frame.inputs.index(name), slope)
            for channel, parts in enumerate(self.base.parts.channels)
            for name, slope in parts.slopes.items()
        ]
        self.places = [(channel, position) for channel, position, _ in slopes]
        self.program = Pointwise([slope for _, _, slope in slopes])
        self.visited: list[tuple[Tensor, float]] = []

    def follow(self, steps: Sequence[Step], modes: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Step the base state and evaluate along it all that its columns need."""
        self.visited.clear()
        found = _march(steps, modes, self.steppers.__getitem__, self.base.frame)
        self._evaluate()
        return found

    def carry(
        self, steps: Sequence[Step], modes: Tensor, chunk: range
    ) -> tuple[Tensor, list[Tensor]]:
        """Step columns along the steps just followed."""
        tendency = _ColumnTendency(self, chunk)
        stepper = cache(lambda h: self.steppers[h].carrying(tendency, modes))
        return _march(steps, modes, stepper, self.frame)

    def _visit(self, modes: Tensor, t: float) -> Tensor:
        self.visited.append((modes, t))
        return self.base(modes, t)

    def _evaluate(self) -> None:
        frame = self.base.frame
        modes = torch.cat([modes for modes, _ in self.visited], dim=1)
        time = torch.tensor([t for _, t in self.visited], dtype=torch.float64)
        time = time.reshape(-1, *(1,) * len(frame.grid.shape))
        slopes = self.base.evaluated(self.program, modes, time.numpy())
        self.coefficients = slopes.to(self.device, self.dtype)
        values = {**self.system.surroundings(0.0, modes.device), "t": Value(time)}
        values |= dict(
            zip(self.system.fields, map(Value, frame.on_grid(modes), modes), strict=True)
        )
        driven = self.sources(values, len(self.visited)).to(self.device, self.dtype)
        # The FFT refuses an empty batch.
        self.driven = self.frame.kept(self.frame.in_modes(driven)) if driven.numel() else driven


class _ColumnTendency:
    """``N'δu + θ`` of a chunk of columns, one call a stage."""

    def __init__(self, model: _Linearised, chunk: range) -> None:
        self.model, self.frame, self.stage = model, model.frame, -1
        self.runs = model.sources.runs(chunk)
        shape = (len(model.base.parts.channels), len(chunk), *model.frame.grid.shape)
        self.whole = torch.zeros(shape, dtype=model.dtype, device=model.device)
        self.channels = self.whole.unbind(0)
        self.slopes = [slopes.unbind(0) for slopes in model.coefficients.unbind(1)]

    def __call__(self, modes: Tensor, t: float) -> Tensor:
        """Return the tendency in modes, ``(field, column, *modes)``."""
        model, channels = self.model, self.channels
        self.stage += 1
        inputs = self.frame.points(modes)
        written = -1
        for (channel, position), slope in zip(model.places, self.slopes[self.stage], strict=True):
            if channel == written:
                channels[channel].addcmul_(inputs[position], slope)
            else:
                torch.mul(inputs[position], slope, out=channels[channel])
            written = channel
        found = self.frame.tendency(self.whole, modes)
        for equation, columns, rows in self.runs:
            found[equation, columns].add_(model.driven[self.stage, rows])
        return found


def _march(
    steps: Sequence[Step], modes: Tensor, stepper: Callable[[float], ETDRK4], frame: Frame
) -> tuple[Tensor, list[Tensor]]:
    outputs = []
    for step in steps:
        if step.begins:
            # As simulate() does, and for its reason.
            modes = frame.kept(frame.in_modes(frame.on_grid(modes)))
        modes = stepper(step.h).step(modes, step.t)
        if step.ends:
            outputs.append(frame.on_grid(modes))
    return modes, outputs


def _blocks(steps: Iterator[Step], size: int) -> Iterator[list[Step]]:
    while block := list(islice(steps, size)):
        yield block
