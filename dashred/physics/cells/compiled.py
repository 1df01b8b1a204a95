"""Finite volumes for many runs, in compiled code."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Protocol

import numpy as np
import torch
from numba.core.errors import NumbaExperimentalFeatureWarning
from torch import Tensor

from dashred.physics.backends.channels import Channels
from dashred.physics.backends.numba_backend import (
    Array,
    WindowFactor,
    compile_kernel,
    names_used,
)
from dashred.physics.cells.compiled_step import (
    CellArrays,
    CellSteps,
    integrate_batch,
    integrate_stages,
)
from dashred.physics.cells.exponential import step_matrices
from dashred.physics.cells.integrate import KEPT, StepTuple
from dashred.physics.cells.linear_part import linear_part
from dashred.physics.cells.operator_matrices import OperatorMatrices
from dashred.physics.expressions.algebra import add
from dashred.physics.expressions.nodes import has_flux
from dashred.physics.expressions.semilinear import (
    OPERAND,
    Input,
    NotSemilinearError,
    SemilinearForm,
)
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.system import System, Term

Schedule = Callable[[Sequence[float], float, Array], Iterable[StepTuple]]


class WeightLayout(Protocol):
    """The part of :class:`.solvers.batch_coefficients.CoefficientLayout` that is needed here."""

    def window_column(self, term: int, /) -> int | None:
        """Return the column of a term's additional coefficient within the window."""

    def factors(self) -> list[WindowFactor]:
        """Return the possible factors of a window."""


class CompiledCells:
    """A system with a condition for each side of its axis, compiled once for many runs.

    The trajectories are those of :func:`.solvers.simulate.simulate`.

    Args:
        system: the system.
        terms: all terms that a trajectory may have, with lets and parameters resolved.
        layout: columns of the weights.
        schedule: (output times, largest step, jumps of inputs) → every step.

    Raises:
        NotSemilinearError, ArithmeticError: the equations have no semilinear form.
    """

    def __init__(
        self, system: System, terms: Sequence[Term], layout: WeightLayout, schedule: Schedule
    ) -> None:
        if any(map(has_flux, (*system.resolved.values(), *(t.expression for t in terms)))):
            raise NotSemilinearError("an upwind flux")
        self.system, self._schedule = system, schedule
        columns = [layout.window_column(j) for j in range(len(terms))]
        windowed = [column for column in columns if column is not None]
        self._channels = channels = Channels(
            system.resolved,
            [(term.equation, term.expression) for term in terms],
            [axis.name for axis in system.axes],
            windowed if windowed else None,
        )
        matrices, extension = OperatorMatrices(system), system.extension
        read = {name: Input(name, OPERAND) for name in system.fields} | channels.inputs
        places = system.grid.places | extension.responses
        self._kernel = compile_kernel(
            channels.functions, list(read), list(places), layout.factors(), system.input_signals
        )
        shape = system.grid.shape
        self._coordinates = np.array([np.broadcast_to(x.numpy(), shape) for x in places.values()])
        self._names, self._count = list(read), len(channels.index)
        inputs = [(v.operator, v.field) for v in read.values()]
        self._input_matrices = _stack([matrices.from_cells(*v).T for v in inputs])
        self._input_given = _stack(
            [extension.effects(field) @ matrices.at_points(v, field).T for v, field in inputs]
        )
        self._channel_matrices = _stack(
            [matrices.to_cells(operator, equation).T for equation, operator in channels.index]
        )
        self._a = linear_part(system)
        self._linear: list[tuple[int | None, Array, Array]] = []
        for weight, form in [(None, channels.base), *enumerate(channels.forms)]:
            self._add_linear(weight, form, matrices)
        self._step = cache(lambda h: np.array([m.T for m in step_matrices(self._a, h)]))

    def with_step(self, dt: float) -> CompiledCells:
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
    ) -> Tensor:
        """Return trajectories ``(batch, time, field, point)``.

        Args:
            start: ``(batch, field, point)`` at ``times[0]``.
            times: output times, ``(time,)``.
            weights: coefficients of the terms, ``(batch, column)``.
            sampled_forcing: free forcing of each trajectory.
        """
        extension = self.system.extension
        cells = extension.cells(start)
        saved = np.full((len(times), len(start), len(self._a)), np.nan)
        saved[0] = cells.flatten(1).numpy()
        steps = list(self._schedule(times.tolist(), self.system.dt, self.system.jumps))
        self._integrate(integrate_batch, weights, sampled_forcing, steps, saved)
        found = torch.from_numpy(saved).reshape(len(times), *cells.shape).transpose(0, 1)
        given = torch.from_numpy(extension.given(times.numpy()))
        return extension.homogeneous(found) + given

    def stages(
        self,
        weights: Tensor,
        sampled_forcing: SampledForcing | None,
        steps: Sequence[StepTuple],
        cells: Array,
    ) -> Array:
        """Return the cells at all stages of one trajectory; see :data:`.integrate.Reference`."""
        saved = np.empty((len(steps), KEPT, len(self._a)))
        saved[0, 0] = cells
        self._integrate(integrate_stages, weights, sampled_forcing, steps, saved)
        return saved

    def _integrate(
        self,
        integrate: Callable[..., None],
        weights: Tensor,
        sampled_forcing: SampledForcing | None,
        steps: Sequence[StepTuple],
        saved: Array,
    ) -> None:
        rows = np.ascontiguousarray(weights.numpy())
        counts = len(self._names), self._count
        with warnings.catch_warnings():
            # Numba warns that first-class functions are an experimental feature.
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            arrays = self._arrays(rows, sampled_forcing)
            integrate(self._kernel, arrays, self._step_arrays(steps), counts, saved)

    def _step_arrays(self, steps: Sequence[StepTuple]) -> CellSteps:
        h, first, last = (np.array([step[i] for step in steps]) for i in (1, 4, 5))
        kinds = {length: k for k, length in enumerate(dict.fromkeys(h.tolist()))}
        clock = np.stack([first, (first + last) / 2, last], axis=1)
        return CellSteps(
            clock=clock,
            kinds=np.array([kinds[length] for length in h.tolist()], dtype=np.int64),
            ends=np.array([step[3] for step in steps], dtype=np.bool_),
            given=self.system.extension.values(clock),
            matrices=np.array([self._step(length) for length in kinds]),
        )

    def _add_linear(
        self, weight: int | None, form: SemilinearForm, matrices: OperatorMatrices
    ) -> None:
        """Add the linear terms of a form, with the effect of given values."""
        parts = [(field, field, add(terms)) for field, terms in form.linear.items() if terms]
        parts += [
            (equation, field, operator)
            for equation, couplings in form.couplings.items()
            for field, operator in couplings.items()
        ]
        found = np.zeros_like(self._a) if weight is not None else -self._a
        given = np.zeros((self.system.extension.count, len(found)))
        for equation, field, operator in parts:
            found = found + matrices.between_cells(operator, equation, field)
            effects = self.system.extension.effects(field)
            whole = effects @ matrices.at_points(operator, field).T
            given[:, matrices.place(equation)] += whole[:, 1::2]
        if found.any() or given.any():
            self._linear.append((weight, found.T, given))

    def _arrays(self, weights: Array, sampled_forcing: SampledForcing | None) -> CellArrays:
        used = (weights != 0).any(axis=0)

        def is_used(column: int | None) -> bool:
            return column is not None and bool(used[column])

        active = [
            f
            for f in self._channels.functions
            if f.weight is f.window_weight is None or is_used(f.weight) or is_used(f.window_weight)
        ]
        read = names_used(active)
        linear = [(k, m, g) for k, m, g in self._linear if k is None or used[k]]
        ones = np.ones(len(weights))
        strengths = [ones if k is None else weights[:, k] for k, _, _ in linear]
        size = len(self._a)
        forcing = np.zeros((0, len(weights), size))
        if sampled_forcing is not None:
            at_cells = self.system.extension.cells(sampled_forcing.values)
            forcing = np.ascontiguousarray(at_cells.flatten(2).transpose(0, 1).numpy())
        knots = np.zeros(0) if sampled_forcing is None else sampled_forcing.knots.numpy()
        return CellArrays(
            inputs=_indices(i for i, name in enumerate(self._names) if name in read),
            input_matrices=self._input_matrices,
            input_given=self._input_given,
            channels=_indices({f.channel for f in active}),
            channel_matrices=self._channel_matrices,
            linear=_stack([m for _, m, _ in linear], (size, size)),
            linear_given=_stack([g for _, _, g in linear], (self.system.extension.count, size)),
            strengths=_stack(strengths, (len(weights),)),
            coordinates=self._coordinates,
            weights=weights,
            knots=knots,
            forcing=forcing,
        )


def _stack(arrays: Sequence[Array], shape: tuple[int, ...] = (0, 0)) -> Array:
    """Return arrays of one shape, stacked; of the given shape if there are none."""
    return np.ascontiguousarray(arrays) if len(arrays) else np.zeros((0, *shape))


def _indices(values: Iterable[int]) -> np.ndarray:
    return np.array(sorted(values), dtype=np.int64)
