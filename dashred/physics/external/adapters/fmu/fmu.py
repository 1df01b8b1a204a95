"""An FMU as a program that steps states."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from dashred.physics.external.adapter import ANY_TIME, Unread, Way
from dashred.physics.external.adapters.fmu.description import (
    MODEL_EXCHANGE,
    SETTABLE,
    Description,
)
from dashred.physics.external.adapters.fmu.instance import Instance
from dashred.physics.external.adapters.fmu.integration import (
    Reached,
    Step,
    longest_step,
    path,
    runge_kutta,
)
from dashred.physics.external.kept.contents import files_sha256
from dashred.physics.external.state_batch import Array, StateBatch


class Given(NamedTuple):
    """What one state is stepped from.

    Attributes:
        state: ``(field,)``.
        t: time.
        dt: length of the step.
        inputs: that the FMU has, by name.
        parameters: likewise.
    """

    state: Array
    t: float
    dt: float
    inputs: dict[str, float]
    parameters: dict[str, float]


class FmuAdapter:
    """An FMU, which steps one state after the other.

    For model exchange its derivatives are integrated here; it is initialised anew only where it has
    events or parameters change. For co-simulation it is initialised at each state.

    Attributes:
        description: of the FMU.
    """

    at_once = 1
    alone = together = (ANY_TIME,)

    def __init__(self, description: Description, fields: Sequence[str], place: str) -> None:
        """Set the FMU, its fields and the location of its key."""
        self.description = description
        self.fields, self.name, self.place = tuple(fields), description.path.name, place
        self._started: dict[str, float] | None = None
        self._longest: float | None = None

    def call(self, batch: StateBatch, way: Way, time: Unread | None = None) -> Array:
        """See :meth:`dashred.physics.external.adapter.Adapter.call`."""
        result = np.empty_like(batch.states)
        for row in range(len(batch)):
            # A state that blows up is reported as such, not as a warning of NumPy.
            with np.errstate(all="ignore"):
                result[row] = self.step(self.given(batch, row))
        return result

    def given(self, batch: StateBatch, row: int) -> Given:
        """Return what one state of a batch is stepped from."""
        inputs = self._known({name: values[row] for name, values in batch.inputs.items()})
        clock = float(batch.t[row]), float(batch.dt[row])
        return Given(batch.states[row], *clock, inputs, self._known(batch.parameters))

    def step(self, given: Given) -> Array:
        """Return the state after a step, ``(field,)``."""
        if self.description.kind == MODEL_EXCHANGE:
            return self._end(given, self.steps_of(given))
        self._start(given)
        self.instance.do_step(given.t, given.dt)
        return self.instance.read_fields()

    def steps_of(self, given: Given) -> int:
        """Return the number of steps in which an FMU for model exchange is integrated."""
        if self._longest is None:
            self._longest = longest_step(lambda steps: self._end(given, steps), given.dt)
        return max(1, math.ceil(given.dt / self._longest * (1 - 1e-9)))

    def follow(self, given: Given, steps: int, step: Step = runge_kutta) -> Iterator[Reached]:
        """Yield the continuous states of an FMU for model exchange after each of some steps."""
        if self._started != given.parameters or self._has_memory:
            self._start(given)
            self._started = dict(given.parameters)
        else:
            inputs = {self.description.others[name]: v for name, v in given.inputs.items()}
            self.instance.set_inputs(inputs)
        x = self.ordered(given.state)
        return path(self.instance, x, given.t, given.dt, steps, step)

    def reset(self) -> None:
        """Initialise the FMU anew at the next step, as must be after an error."""
        self._started = None

    def ordered(self, values: Array) -> Array:
        """Return values of fields ``(field, …)`` in the order of the continuous states."""
        found = np.empty_like(values)
        found[[*self.description.order]] = values
        return found

    def of_fields(self, values: Array) -> Array:
        """Return values of continuous states ``(state, …)`` in the order of the fields."""
        return values[[*self.description.order]]

    @property
    def offers_derivatives(self) -> bool:
        """Whether its derivatives of the continuous states have directional derivatives."""
        return self.description.kind == MODEL_EXCHANGE and self.description.offers_derivatives

    @cached_property
    def instance(self) -> Instance:
        """The FMU in this process."""
        return Instance(self.description)

    def sha256(self) -> str:
        """See :meth:`dashred.physics.external.adapter.Adapter.sha256`."""
        names = [variable.name for variable in self.description.fields]
        names += [f"{name}={v.name}" for name, v in self.description.others.items()]
        return files_sha256([*names, self.description.kind], [self.description.path])

    @property
    def _has_memory(self) -> bool:
        """Whether the FMU must be initialised at each state: it has events, or discrete inputs."""
        others = self.description.others.values()
        discrete = any(v.causality == "input" and v.variability != "continuous" for v in others)
        return discrete or self.instance.has_events

    def _known(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters or inputs that the FMU has; the others are of the law."""
        return {k: float(v) for k, v in values.items() if k in self.description.others}

    def _start(self, given: Given) -> None:
        values: list[tuple[Any, float]] = [
            (self.description.others[name], value)
            for name, value in (given.parameters | given.inputs).items()
        ]
        fields = zip(self.description.fields, map(float, given.state), strict=True)
        values += [(variable, x) for variable, x in fields if variable.initial in SETTABLE]
        self.instance.start(given.t, values)

    def _end(self, given: Given, steps: int) -> Array:
        x = given.state
        for reached in self.follow(given, steps):
            x = self.of_fields(reached.x)
        return x
