"""A step of a program from the states of all segments, with its Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dashred.inference.segments.segments import Array
from dashred.inference.segments.steps.kept_derivatives import KeptDerivatives
from dashred.physics.external.protocol import Program, Stepper
from dashred.physics.program_parameters import changed_parameters, parameter_slopes

# Smallest change in a difference, as a share of the largest value of any field.
SMALLEST = 1e-12


@dataclass(frozen=True)
class ProgramStep:
    """A program of a system without axes.

    Attributes:
        program: steps states.
        parameters: its parameters by name.
        names: of the parameters that are unknowns.
    """

    program: Program
    parameters: Mapping[str, float]
    names: tuple[str, ...] = ()
    # Derivatives by the state, and by each parameter, of each step within the segments.
    _kept: dict[tuple[int, str | None], KeptDerivatives] = field(default_factory=dict, repr=False)
    # Places and ends of each step in the last run: what a run accepts is linearised next.
    _ends: dict[int, tuple[Array, Array]] = field(default_factory=dict, repr=False)

    def at(self, changes: Mapping[str, float]) -> ProgramStep:
        """Return the same with changed parameters, which are unknowns."""
        changed = changed_parameters(self.parameters, changes)
        return replace(self, parameters=changed, names=tuple(changes))

    def slopes(
        self,
        names: Sequence[str],
        x: Array,
        after: Array,
        t: Array,
        h: Array,
        inputs: Mapping[str, Array],
    ) -> Array:
        """Return the derivatives of a step by parameters, ``(name, segment, field)``.

        The states after the step are ``(segment, field)``; see :meth:`advance` for the others.
        """
        return parameter_slopes(
            lambda parameters: self.program.step(x, t, h, inputs, parameters),
            after,
            self.parameters,
            names,
            self.program.rounding,
        )

    def advance(
        self, step: int, x: Array, t: Array, h: Array, inputs: Mapping[str, Array]
    ) -> Array:
        """Return the states after a step, ``(segment, field)``.

        Args:
            step: index of the step within the segments.
            x: ``(segment, field)``.
            t: time of each, ``(segment,)``.
            h: step of each, ``(segment,)``.
            inputs: in the middle of the step, ``(segment,)`` each.
        """
        ends = self.ends(x, t, h, inputs)
        self._ends[step] = self._places(x), ends
        return ends

    def ends(self, x: Array, t: Array, h: Array, inputs: Mapping[str, Array]) -> Array:
        """Return the states after a step of any states, ``(state, field)``; see :meth:`advance`."""
        return self.program.step(x, t, h, inputs, self.parameters)

    def linearise(
        self, step: int, x: Array, t: Array, h: Array, inputs: Mapping[str, Array]
    ) -> tuple[Array, Array, Array]:
        """Return the states after a step, and their derivatives by the states and parameters.

        The derivatives are ``(segment, field, field)`` and ``(segment, field, name)``. They come
        from one-sided differences, or the tangents of the program; all segments and fields are one
        batch. Where state and parameters are near those of an earlier call, its derivatives are
        used; where all are those of the last run, its states are.

        See :meth:`advance` for the arguments.
        """
        places, reach = self._places(x), reach_of(x)
        sizes = np.concatenate([reach, np.abs(places[0, x.shape[1] :])])
        about, ends = self._ends.get(step, (None, None))
        if about is None or not np.array_equal(about, places):
            ends = None
        kept = self._kept.setdefault((step, None), KeptDerivatives())
        new = kept.far(places, sizes)
        after, found = self.differentiate(x, reach, new, t, h, inputs, ends)
        jacobian, columns = kept.renewed(new, places, found), []
        for name in self.names:
            kept = self._kept.setdefault((step, name), KeptDerivatives())
            new = kept.far(places, sizes)
            if new.size:
                [found] = self.slopes([name], x[new], after[new], *clock_of(new, t, h, inputs))
            columns.append(kept.renewed(new, places, found) if new.size else kept.values)
        return after, jacobian, np.stack(columns, -1) if columns else np.empty((*x.shape, 0))

    def _places(self, x: Array) -> Array:
        """Return the states with all parameters, ``(segment, field + parameter)``."""
        values = np.array([*self.parameters.values()])
        return np.concatenate([x, np.tile(values, (len(x), 1))], axis=1)

    def differentiate(
        self,
        x: Array,
        reach: Array,
        rows: NDArray[np.intp],
        t: Array,
        h: Array,
        inputs: Mapping[str, Array],
        ends: Array | None = None,
    ) -> tuple[Array, Array]:
        """Return the states after a step, and the Jacobians of some, ``(row, field, field)``.

        Args:
            x: ``(segment, field)``.
            reach: size of each field, ``(field,)``.
            rows: segments whose Jacobians are computed.
            t: as in :meth:`linearise`, and so are the others.
            h: step.
            inputs: in the middle of the step.
            ends: the states after the step, if they are known, ``(segment, field)``.
        """
        if self.program.tangent is not None:
            return self._push(self.program.tangent, x, rows, t, h, inputs, ends)
        fields = x.shape[1]
        if ends is not None and not rows.size:
            return ends, np.empty((0, fields, fields))
        small = self.program.rounding**0.5 * reach
        moved = x[rows] + small[:, None, None] * np.eye(fields)[:, None, :]
        # The states themselves are part of the batch, unless their ends are known.
        own = np.arange(0 if ends is not None else len(x))
        asked = np.concatenate([own, np.tile(rows, fields)])
        whole = np.concatenate([x[own], moved.reshape(-1, fields)])
        found = self.ends(whole, *clock_of(asked, t, h, inputs))
        after = found[: len(x)] if ends is None else ends
        others = found[len(own) :].reshape(fields, len(rows), fields)
        return after, np.moveaxis((others - after[rows]) / small[:, None, None], 0, -1)

    def _push(
        self,
        tangent: Stepper,
        x: Array,
        rows: NDArray[np.intp],
        t: Array,
        h: Array,
        inputs: Mapping[str, Array],
        ends: Array | None,
    ) -> tuple[Array, Array]:
        """Return what :meth:`differentiate` does, with the tangents that the program offers."""
        count, fields = x.shape
        after = np.empty_like(x) if ends is None else ends.copy()
        jacobians = np.empty((len(rows), fields, fields))
        rest = np.setdiff1d(np.arange(count), rows)
        if rest.size and ends is None:
            after[rest] = self.ends(x[rest], *clock_of(rest, t, h, inputs))
        if rows.size:
            each = np.repeat(rows, fields)
            states = np.concatenate([x[each], np.tile(np.eye(fields), (len(rows), 1))], axis=1)
            found = tangent.step(states, *clock_of(each, t, h, inputs), self.parameters)
            if ends is None:
                after[rows] = found[::fields, :fields]
            moved = found[:, fields:].reshape(len(rows), fields, fields)
            jacobians[:] = np.moveaxis(moved, 1, 2)
        return after, jacobians


def clock_of(
    rows: NDArray[np.intp], t: Array, h: Array, inputs: Mapping[str, Array]
) -> tuple[Array, Array, dict[str, Array]]:
    """Return time, step and inputs of some segments."""
    return t[rows], h[rows], {name: values[rows] for name, values in inputs.items()}


def reach_of(x: Array) -> Array:
    """Return the largest value of each field, ``(field,)``, of states ``(segment, field)``."""
    size = np.where(np.isfinite(x), np.abs(x), 0.0)
    return np.maximum(size.max(axis=0), SMALLEST * max(1.0, float(size.max())))
