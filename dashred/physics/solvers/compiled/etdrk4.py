"""Integrate batches of spectral states with ETDRK4 on the CPU, in compiled code."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Callable, Sequence

import numpy as np
import torch
from numba.core.errors import NumbaExperimentalFeatureWarning
from torch import Tensor

from dashred.core.threads import in_threads, thread_count
from dashred.core.work import count_transforms
from dashred.physics.backends.numba_backend import Array
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.solvers.compiled.rhs import CompiledTendency
from dashred.physics.solvers.compiled.step import (
    STAGES,
    StepArrays,
    integrate_row,
    integrate_rows,
)
from dashred.physics.solvers.compiled.step_factors import step_factors
from dashred.physics.solvers.compiled.tendency import Modes
from dashred.physics.solvers.etdrk4 import CACHE_SIZE
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import schedule
from dashred.physics.system import System, Term
from dashred.physics.window import Shape

Progress = Callable[[float], None]
ALL = slice(0, None)


class CompiledETDRK4:
    """A spectral system compiled for many runs.

    It returns the trajectories of :func:`simulate` several times as fast, after some seconds of
    compilation.

    Args:
        system: a spectral system.
        terms: all terms that a trajectory may have, with lets and parameters resolved.
        shapes: the possible factors of the windows of these terms.

    Raises:
        NotSemilinearError, ArithmeticError: the equations have no semilinear form.
    """

    def __init__(
        self, system: System, terms: Sequence[Term], shapes: tuple[Shape, ...] = ()
    ) -> None:
        self.system = system
        self.tendency = CompiledTendency(system, terms, shapes)
        self._known: dict[tuple[bytes, tuple[float, ...]], Modes] = {}

    def with_step(self, dt: float) -> CompiledETDRK4:
        """Return a copy with another time step, without recompilation."""
        other = copy.copy(self)
        other.system = self.system.with_step(dt)
        return other

    def __call__(
        self,
        start: Tensor,
        times: Tensor,
        weights: Tensor,
        sampled_forcing: SampledForcing | None = None,
        progress: Progress | None = None,
        rows: slice = ALL,
    ) -> Tensor:
        """Return trajectories ``(row, time, field, *grid)``.

        Args:
            start: ``(row, field, *grid)`` at ``times[0]``.
            times: output times, ``(time,)``.
            weights: coefficients of the terms, ``(batch, column)``, in the order of
                :class:`dashred.physics.solvers.batch_coefficients.CoefficientLayout`.
            sampled_forcing: free forcing of each trajectory of the batch.
            progress: called with the fraction done.
            rows: the trajectories of the batch that are wanted; their bits do not depend on that.
        """
        batch = self.tendency.batch(weights.numpy(), sampled_forcing)
        steps = StepArrays.of(list(schedule(times.tolist(), self.system.dt, self.system.jumps)))
        factors_of, arrays = self._factors(batch.linear, rows, steps), batch.of_rows(rows)
        fields, shape = start.shape[1], self.system.grid.shape
        states = np.full((len(start), len(times), fields, math.prod(shape)), np.nan)
        states[:, 0] = start.numpy().reshape(len(start), fields, -1)
        axes = tuple(range(1, len(shape) + 1))
        made = STAGES * len(steps.h) * batch.transforms(rows) + steps.turns * len(start) * fields
        count_transforms(made, math.prod(shape))

        def run(row: int) -> None:
            integrate_row(
                self.tendency.kernel,
                row,
                arrays,
                steps,
                factors_of(row),
                shape,
                axes,
                batch.counts,
                states,
            )

        with warnings.catch_warnings():
            # Numba warns that first-class functions are an experimental feature.
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            for done in in_threads(run, len(start)):
                if progress is not None:
                    progress(done)
        return torch.from_numpy(states.reshape(*states.shape[:3], *shape))

    def leap(self, weights: Tensor, span: float) -> Callable[[Array, float], Array]:
        """Return the flow over one span without jumps, for many calls with the same weights.

        It maps states ``(row, field*point)`` and the time at which they are to states.
        """
        batch = self.tendency.batch(weights.numpy())
        steps = StepArrays.of(list(schedule([0.0, span], self.system.dt)))
        factors = step_factors(batch.linear, steps.lengths)
        rows, fields, shape = len(weights), batch.linear.shape[1], self.system.grid.shape
        points, axes = math.prod(shape), tuple(range(1, len(shape) + 1))
        made = STAGES * len(steps.h) * batch.transforms(ALL) + steps.turns * rows * fields
        blocks = min(rows, thread_count())
        ends = [rows * i // blocks for i in range(blocks + 1)]

        def run(start: Array, begin: float) -> Array:
            states = np.full((rows, 2, fields, points), np.nan)
            states[:, 0] = start.reshape(rows, fields, points)
            moved = steps._replace(clock=begin + steps.clock)
            count_transforms(made, points)
            rest = batch.arrays, moved, factors, shape, axes, batch.counts, states

            def run_block(block: int) -> None:
                integrate_rows(self.tendency.kernel, ends[block], ends[block + 1], *rest)

            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
                for _ in in_threads(run_block, blocks):
                    pass
            return states[:, 1].reshape(rows, -1)

        return run

    def _factors(self, linear: Modes, rows: slice, steps: StepArrays) -> Callable[[int], Modes]:
        """Return a function from the index of a row within ``rows`` to its coefficients.

        If all trajectories share L, the coefficients are cached. Otherwise those of a row are
        computed when it is integrated: writing those of all rows to memory first takes longer than
        computing them.
        """
        if len(linear) > 1:
            own = linear[rows]
            return lambda row: step_factors(own[row : row + 1], steps.lengths)
        key = linear.tobytes(), tuple(steps.lengths.tolist())
        if key not in self._known:
            if len(self._known) == CACHE_SIZE:
                del self._known[next(iter(self._known))]
            self._known[key] = step_factors(linear, steps.lengths)
        shared = self._known[key]
        return lambda row: shared


def integrate_etdrk4(
    system: System,
    start: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    progress: Progress | None,
) -> Tensor:
    """Compile the system for one run and return what :func:`.simulate.simulate` returns.

    Raises:
        NotSemilinearError, ArithmeticError: the equations have no semilinear form.
    """
    if forcing is None:
        forcing = Forcing((), torch.zeros((len(start), 0), dtype=torch.float64))
    compiled = CompiledETDRK4(system, forcing.terms)
    return compiled(start, times, forcing.coefficients, progress=progress)
