"""The trajectory about which the equations are linearised, integrated by compiled code."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import cache

import numpy as np
from numba.core.errors import NumbaExperimentalFeatureWarning
from torch import Tensor

from dashred.core.work import count_transforms
from dashred.physics.backends.numpy_backend import Array
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.solvers.compiled.etdrk4 import ALL, CompiledETDRK4
from dashred.physics.solvers.compiled.step import STAGES, StepArrays, integrate_stages
from dashred.physics.solvers.compiled.step_factors import step_factors
from dashred.physics.solvers.schedule import Step
from dashred.physics.tangents.reference_trajectory import Stages, stage_times
from dashred.physics.tangents.semilinear_rhs import Modes


class CompiledTrajectory:
    """Integrates one state with a compiled system, several times as fast as NumPy.

    Args:
        compiled: the system with all terms.
        weights: coefficients of the terms, ``(1, column)``.
        sampled_forcing: free forcing, one row.
    """

    def __init__(
        self, compiled: CompiledETDRK4, weights: Tensor, sampled_forcing: SampledForcing | None
    ) -> None:
        self._shape, self._kernel = compiled.system.grid.shape, compiled.tendency.kernel
        self._batch = compiled.tendency.batch(weights.numpy(), sampled_forcing)
        self._factors = cache(lambda h: step_factors(self._batch.linear, [h]))

    def advance(self, steps: Sequence[Step], modes: Modes) -> tuple[Modes, list[Array], Stages]:
        """See :meth:`.reference_trajectory.ReferenceTrajectory.advance`."""
        arrays = StepArrays.of(steps)
        fields, size = len(modes), modes[0].size
        end = modes.reshape(fields, size).copy()
        states = np.empty((sum(step.ends for step in steps), fields, int(np.prod(self._shape))))
        stages = np.empty((len(steps), STAGES, fields, size), dtype=np.complex128)
        rates = np.empty_like(stages)
        # A state that is transformed to modes was transformed to the grid before.
        turns = 2 * int(arrays.begins.sum()) + int(arrays.ends.sum())
        made = STAGES * len(steps) * self._batch.transforms(ALL) + turns * fields
        count_transforms(made, states.shape[2])
        with warnings.catch_warnings():
            # Numba warns that first-class functions are an experimental feature.
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            integrate_stages(
                self._kernel,
                self._batch.arrays,
                arrays,
                np.concatenate([self._factors(h) for h in arrays.lengths.tolist()]),
                self._shape,
                tuple(range(1, len(self._shape) + 1)),
                self._batch.counts,
                end,
                states,
                stages,
                rates,
            )
        outputs = [state.reshape(fields, 1, *self._shape) for state in states]
        both = _by_field(stages, modes), _by_field(rates, modes)
        return end.reshape(modes.shape), outputs, Stages(stage_times(steps), *both)


def _by_field(stages: Modes, like: Modes) -> Modes:
    """Reorder ``(step, 4, field, mode)`` to ``(field, stage, *modes)``."""
    flat = stages.reshape(-1, *stages.shape[2:]).swapaxes(0, 1)
    return np.ascontiguousarray(flat).reshape(len(like), -1, *like.shape[2:])
