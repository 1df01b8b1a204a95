"""March batches of spectral states through time on the CPU, in compiled code."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.physics.compiled_tendency import CompiledTendency, Modes, Weighted
from dashred.physics.forcing import Forcing
from dashred.physics.integrators.etdrk4 import ETDRK4
from dashred.physics.integrators.schedule import schedule
from dashred.physics.system import System, Term
from dashred.physics.transforms import from_modes, to_modes

Progress = Callable[[float], None]


class CompiledMarch:
    """The same trajectories as :func:`dashred.physics.simulate.simulate`, several times as fast.

    Worth its seconds of compilation where many runs are made of one system.

    Args:
        system: a spectral system.
        terms: whatever a trajectory may carry, lets and parameters resolved.

    Raises:
        NotSeparableError, ArithmeticError: the equations cannot be taken apart.
    """

    def __init__(self, system: System, terms: Sequence[Term]) -> None:
        self.system = system
        self.tendency = CompiledTendency(system, terms)

    def with_step(self, dt: float) -> CompiledMarch:
        """Return the same with another time step, nothing compiled again."""
        other = copy.copy(self)
        other.system = self.system.with_step(dt)
        return other

    def __call__(
        self, start: Tensor, times: Tensor, weights: Tensor, progress: Progress | None = None
    ) -> Tensor:
        """Return trajectories ``(batch, time, field, *grid)``.

        Args:
            start: ``(batch, field, *grid)`` at ``times[0]``.
            times: output times, ``(time,)``.
            weights: coefficient of every term, ``(batch, term)``.
            progress: called with the fraction done after every output time.
        """
        batch = self.tendency.of(weights.numpy())
        steppers: dict[float, _Step] = {}
        shape = self.system.grid.shape
        saved = [start]
        points: NDArray[np.float64] = start.numpy()
        modes: Modes = np.empty(0, dtype=np.complex128)
        # A trajectory that blows up is told by its values.
        with np.errstate(all="ignore"):
            for step in schedule(times.tolist(), self.system.dt):
                if step.begins:
                    # Rounding makes modes that are no real field's, which the equations cannot
                    # see and a linear instability would amplify without end.
                    modes = batch.kept(to_modes(np.ascontiguousarray(points), len(shape)))
                if step.h not in steppers:
                    steppers[step.h] = _Step(batch, step.h)
                modes = steppers[step.h](modes, step.t)
                if step.ends:
                    points = from_modes(modes, shape)
                    saved.append(torch.from_numpy(points))
                    if progress is not None:
                        progress((len(saved) - 1) / (len(times) - 1))
        return torch.stack(saved, dim=1)


def march_compiled(
    system: System,
    start: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    progress: Progress | None,
) -> Tensor:
    """Return what :func:`dashred.physics.simulate.simulate` returns, compiled for this run.

    Raises:
        NotSeparableError, ArithmeticError: the equations cannot be taken apart.
    """
    if forcing is None:
        forcing = Forcing((), torch.zeros((len(start), 0), dtype=torch.float64))
    march = CompiledMarch(system, forcing.terms)
    return march(start, times, forcing.coefficients, progress)


class _Step:
    """One step of ETDRK4, as :class:`ETDRK4` takes it.

    Where L is real the modes are combined as pairs of real numbers, at half the cost.
    """

    def __init__(self, batch: Weighted, h: float) -> None:
        self.batch, self.h = batch, h
        linear = torch.from_numpy(batch.linear)
        stepper = ETDRK4(linear, lambda modes, t: modes, h)
        parts = stepper.full, stepper.half, stepper.q, stepper.first, stepper.middle, stepper.last
        self.real = bool((linear.imag == 0).all())
        found = [part.numpy() for part in parts]
        if self.real:
            found = [np.repeat(part.real, 2, axis=-1) for part in found]
        self.full, self.half, self.q, self.first, self.middle, self.last = found

    def __call__(self, modes: Modes, t: float) -> Modes:
        """Return the modes at ``t + h``."""
        u, n_u = self.view(modes), self.rate(modes, t)
        linear_half = self.half * u
        a = self.q * n_u
        a += linear_half
        n_a = self.rate(self.unview(a), t + self.h / 2)
        b = self.q * n_a
        b += linear_half
        n_b = self.rate(self.unview(b), t + self.h / 2)
        c = 2 * n_b
        c -= n_u
        c *= self.q
        a *= self.half
        c += a
        n_c = self.rate(self.unview(c), t + self.h)
        n_a += n_b
        n_a *= self.middle
        n_u *= self.first
        n_c *= self.last
        found = self.full * u
        found += n_u
        found += n_a
        found += n_c
        return self.unview(found)

    def rate(self, modes: Modes, t: float) -> NDArray[Any]:
        """Return N."""
        return self.view(self.batch(modes, t))

    def view(self, modes: Modes) -> NDArray[Any]:
        """Return the modes as they are combined."""
        return modes.view(np.float64) if self.real else modes

    def unview(self, values: NDArray[Any]) -> Modes:
        """Return them as modes again."""
        return values.view(np.complex128) if self.real else values
