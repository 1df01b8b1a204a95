"""Sensors of an ODE system: expressions of state, inputs and parameters, and their derivatives.

With changes c of the parameters that a sensor depends on::

    y = h(x) + Σ_p c_p ∂h/∂p(x, t)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dashred.data.sensors import Sensor
from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.segments import Array
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import ZERO, Expr, Name, Number, add, multiply
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.parameter_sensitivity import reading_slopes
from dashred.physics.system import System


@dataclass(frozen=True)
class ReadChanges:
    """Changes of the parameters that sensors depend on.

    Attributes:
        names: of the parameters.
        values: their changes, ``(parameter,)``.
        places: index of each among all changes of the tendency, ``(parameter,)``.
        clock: time and inputs of the states, with the shape of the samples.
    """

    names: tuple[str, ...] = ()
    values: Array = field(default_factory=lambda: np.zeros(0))
    places: tuple[int, ...] = ()
    clock: Mapping[str, Array] = field(default_factory=dict)


UNCHANGED = ReadChanges()


class StateSensors:
    """``y = h(x)`` of every sensor.

    Attributes:
        names: of the sensors.
        fields: index of the field that a sensor reads, up to gain and offset, ``(sensor,)``; -1 for
            the others.
        curved: index of the one field of which a sensor reads another function, ``(sensor,)``; -1
            for the others.
        parameters: names of the parameters that a sensor depends on.

    Args:
        sensors: of the recording.
        system: whose state they read.
    """

    def __init__(self, sensors: Sequence[Sensor], system: System) -> None:
        self.names = tuple(sensor.name for sensor in sensors)
        self._states = list(system.fields)
        self._reads = [system.resolve(system.parse(s.reads, s.reads), s.reads) for s in sensors]
        self._by_parameter = [
            {
                name: system.resolve(slope, sensor.reads)
                for name, slope in reading_slopes(system, sensor.quantities).items()
            }
            for sensor in sensors
        ]
        self.parameters = frozenset(name for slopes in self._by_parameter for name in slopes)
        self._compiled: dict[tuple[str, ...], tuple[Pointwise, Pointwise, Pointwise]] = {}
        found = [_affine(expr, self._states) for expr in self._reads]
        self.fields = np.array([place for place, _, _ in found])
        self.curved = np.array(
            [
                _only_field(h, self._states) if j < 0 else -1
                for h, (j, _, _) in zip(self._reads, found, strict=True)
            ]
        )
        self._gains = np.array([gain for _, gain, _ in found])
        self._offsets = np.array([offset for _, _, offset in found])

    @property
    def names_read(self) -> frozenset[str]:
        """Names that any sensor reads."""
        return frozenset().union(*map(algebra.names, self._reads))

    def fields_of(self, readings: Array) -> Array:
        """Return readings ``(…, sensor)`` as values of the field that each sensor reads."""
        found: Array = (readings - self._offsets) / self._gains
        return found

    def stds_of_fields(self, noise_std: Array) -> Array:
        """Return σ of readings ``(…, sensor)`` as that of the field that each sensor reads."""
        found: Array = noise_std / np.abs(self._gains)
        return found

    def changes(
        self, candidates: Sequence[Candidate], xi: Array, clock: Mapping[str, Array]
    ) -> ReadChanges:
        """Return the changes that the sensors see, of all changes of the tendency.

        Args:
            candidates: terms and parameters.
            xi: their coefficients, ``(candidate,)``.
            clock: time and inputs of the states that will be read.
        """
        places = [
            j
            for j, candidate in enumerate(candidates)
            if candidate.equation is None and candidate.name in self.parameters
        ]
        names = tuple(candidates[j].name for j in places)
        return ReadChanges(names, xi[places], tuple(places), clock) if names else UNCHANGED

    def read(self, states: Array, changes: ReadChanges = UNCHANGED) -> Array:
        """Return readings ``(…, sensor)`` of states ``(…, field)``."""
        return self._evaluate(0, states, changes)

    def slopes(self, states: Array, changes: ReadChanges = UNCHANGED) -> Array:
        """Return the derivatives of the readings, ``(…, sensor, field)``."""
        found = self._evaluate(1, states, changes)
        return found.reshape(*states.shape[:-1], -1, len(self._states))

    def slope_of_curved(self, sensor: int, states: Array) -> Array:
        """Return the derivative of a function of one field alone, at states ``(…, field)``."""
        name = self._states[self.curved[sensor]]
        slope = Pointwise([differentiate(self._reads[sensor], name)])
        values = {name: states[..., self.curved[sensor]]}
        return slope(values, states.shape[:-1])[0]

    def by_parameter(self, states: Array, changes: ReadChanges) -> Array:
        """Return the derivatives by the changed parameters, ``(…, sensor, parameter)``."""
        found = self._evaluate(2, states, changes)
        return found.reshape(*states.shape[:-1], len(self.names), -1)

    def _evaluate(self, which: int, states: Array, changes: ReadChanges) -> Array:
        named = dict(zip(self._states, np.moveaxis(states, -1, 0), strict=True))
        moved = {_symbol(p): v for p, v in zip(changes.names, changes.values, strict=True)}
        functions = self._functions(changes.names)[which]
        found = functions({**changes.clock, **named, **moved}, states.shape[:-1])
        return np.moveaxis(found, 0, -1)

    def _functions(self, parameters: tuple[str, ...]) -> tuple[Pointwise, Pointwise, Pointwise]:
        """Return the readings, and their derivatives by fields and by parameters."""
        if parameters not in self._compiled:
            slopes = [[own.get(p, ZERO) for p in parameters] for own in self._by_parameter]
            reads = [
                add(
                    [
                        h,
                        *(
                            multiply((Name(_symbol(p)), s))
                            for p, s in zip(parameters, own, strict=True)
                        ),
                    ]
                )
                for h, own in zip(self._reads, slopes, strict=True)
            ]
            self._compiled[parameters] = (
                Pointwise(reads),
                Pointwise([differentiate(expr, name) for expr in reads for name in self._states]),
                Pointwise([slope for own in slopes for slope in own]),
            )
        return self._compiled[parameters]


def _symbol(parameter: str) -> str:
    """Return the name of the change of a parameter, which is not a name of the language."""
    return f"change of {parameter}"


def _only_field(expr: Expr, fields: Sequence[str]) -> int:
    """Return the field x of a function of x alone; -1 for another function."""
    read = list(algebra.names(expr))
    return fields.index(read[0]) if len(read) == 1 and read[0] in fields else -1


def _affine(expr: Expr, fields: Sequence[str]) -> tuple[int, float, float]:
    """Return the field x, a and b of ``a x + b``; -1, 1 and 0 for another function."""
    slopes = [differentiate(expr, name) for name in fields]
    moved = [j for j, slope in enumerate(slopes) if slope != ZERO]
    if len(moved) != 1 or not isinstance(slope := slopes[moved[0]], Number):
        return -1, 1.0, 0.0
    rest = add([expr, multiply((Number(-slope.value), Name(fields[moved[0]])))])
    if rest != ZERO and not isinstance(rest, Number):
        return -1, 1.0, 0.0
    return moved[0], float(slope.value), 0.0 if rest == ZERO else float(rest.value)
