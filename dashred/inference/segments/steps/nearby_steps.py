"""Steps of an expensive program, also from those of states nearby.

Near a state a whose step is known, with its Jacobian::

    P(x) = P(a) + P'(a) (x - a) + O(|x - a|²)

Parameters that are unknowns count like further fields.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dashred.inference.segments.segments import Array
from dashred.inference.segments.steps.program_step import ProgramStep, clock_of, reach_of
from dashred.physics.external.protocol import Program

# A program that takes longer for a state is called for fewer of them, in s.
EXPENSIVE = 0.02
# Its steps are used again at states that differ by less than this share of the largest value of
# each field, and at parameters that differ by less than this share of their values. The relative
# error of a step is about half of the square of that.
NEAR = 0.03
Key = tuple[float | str, ...]


@dataclass(frozen=True)
class KnownSteps:
    """Steps at one time, with one length, inputs and known parameters.

    Attributes:
        starts: a, the states and the parameters that are unknowns, ``(state, field + name)``.
        ends: P(a), ``(state, field)``.
        jacobians: P'(a), ``(state, field, field + name)``.
    """

    starts: Array
    ends: Array
    jacobians: Array

    def joined(self, other: KnownSteps) -> KnownSteps:
        """Return the steps of both."""
        return KnownSteps(
            np.concatenate([self.starts, other.starts]),
            np.concatenate([self.ends, other.ends]),
            np.concatenate([self.jacobians, other.jacobians]),
        )


# All segments of a program share its steps, whatever their lengths.
_of_programs: WeakKeyDictionary[Program, dict[Key, KnownSteps]] = WeakKeyDictionary()


@dataclass(frozen=True)
class NearbySteps:
    """An expensive program of a system without axes; the counterpart of :class:`ProgramStep`.

    Attributes:
        exact: calls the program.
    """

    exact: ProgramStep
    _known: dict[Key, KnownSteps] = field(repr=False)

    def at(self, changes: Mapping[str, float]) -> NearbySteps:
        """See :meth:`ProgramStep.at`."""
        return NearbySteps(self.exact.at(changes), self._known)

    def slopes(
        self,
        names: Sequence[str],
        x: Array,
        after: Array,
        t: Array,
        h: Array,
        inputs: Mapping[str, Array],
    ) -> Array:
        """See :meth:`ProgramStep.slopes`."""
        return self.exact.slopes(names, x, after, t, h, inputs)

    def advance(
        self, step: int, x: Array, t: Array, h: Array, inputs: Mapping[str, Array]
    ) -> Array:
        """See :meth:`ProgramStep.advance`."""
        ends, _, far = self._nearby(self._keys(t, h, inputs), x)
        if far.size:
            ends[far] = self.exact.ends(x[far], *clock_of(far, t, h, inputs))
        return ends

    def linearise(
        self, step: int, x: Array, t: Array, h: Array, inputs: Mapping[str, Array]
    ) -> tuple[Array, Array, Array]:
        """See :meth:`ProgramStep.linearise`."""
        keys, fields = self._keys(t, h, inputs), x.shape[1]
        ends, jacobians, far = self._nearby(keys, x)
        if far.size:
            clock, exact = clock_of(far, t, h, inputs), self.exact
            ends[far], own = exact.differentiate(x[far], reach_of(x), np.arange(far.size), *clock)
            moved = exact.slopes(exact.names, x[far], ends[far], *clock)
            jacobians[far] = np.concatenate([own, np.moveaxis(moved, 0, -1)], axis=2)
            self._keep([keys[row] for row in far], self._places(x[far]), ends[far], jacobians[far])
        return ends, jacobians[:, :, :fields], jacobians[:, :, fields:]

    def _keys(self, t: Array, h: Array, inputs: Mapping[str, Array]) -> list[Key]:
        names, stated = self.exact.names, sorted(self.exact.parameters.items())
        fixed = [value for name, value in stated if name not in names]
        columns = [t, h, *(values for _, values in sorted(inputs.items()))]
        return [(*row, *fixed, *names) for row in np.stack(columns, axis=1).tolist()]

    def _places(self, x: Array) -> Array:
        """Return states with the parameters that are unknowns, ``(state, field + name)``."""
        values = np.array([self.exact.parameters[name] for name in self.exact.names])
        return np.concatenate([x, np.tile(values, (len(x), 1))], axis=1)

    def _nearby(self, keys: list[Key], x: Array) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return ends and Jacobians from steps nearby, and the rows that have none."""
        places, fields = self._places(x), x.shape[1]
        ends, jacobians = np.empty_like(x), np.empty((len(x), fields, places.shape[1]))
        # A parameter of 0 has no other nearby.
        reach = np.concatenate([reach_of(x), np.maximum(np.abs(places[0, fields:]), 1e-100)])
        far = []
        for row, key in enumerate(keys):
            known = self._known.get(key)
            if known is None:
                far.append(row)
                continue
            away = places[row] - known.starts
            distance = np.abs(away / reach).max(axis=1)
            nearest = int(np.argmin(distance))
            jacobians[row] = known.jacobians[nearest]
            ends[row] = known.ends[nearest] + jacobians[row] @ away[nearest]
            # Written with "not", because the state may be NaN.
            if not distance[nearest] < NEAR:
                far.append(row)
        return ends, jacobians, np.array(far, dtype=np.intp)

    def _keep(self, keys: list[Key], places: Array, ends: Array, jacobians: Array) -> None:
        for row, key in enumerate(keys):
            new = KnownSteps(places[[row]], ends[[row]], jacobians[[row]])
            if np.isfinite(new.ends).all() and np.isfinite(new.jacobians).all():
                known = self._known.get(key)
                self._known[key] = new if known is None else known.joined(new)


def step_of(program: Program, parameters: Mapping[str, float]) -> ProgramStep | NearbySteps:
    """Return the step of a program; before its first call it counts as cheap."""
    exact = ProgramStep(program, parameters)
    if program.seconds <= EXPENSIVE:
        return exact
    return NearbySteps(exact, _of_programs.setdefault(program, {}))
