"""An FMU as a program that steps states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from dashred.physics.external.adapter import ANY_TIME, Unread, Way
from dashred.physics.external.fmu.description import (
    MODEL_EXCHANGE,
    SETTABLE,
    Description,
)
from dashred.physics.external.fmu.instance import Instance
from dashred.physics.external.fmu.integration import integrate, longest_step
from dashred.physics.external.kept.contents import files_sha256
from dashred.physics.external.state_batch import Array, StateBatch


class FmuAdapter:
    """An FMU, which steps one state after the other.

    For model exchange its derivatives are integrated here; it is initialised anew only where it has
    events or parameters change. For co-simulation it is initialised at each state.
    """

    parallel = False
    alone = together = (ANY_TIME,)

    def __init__(self, description: Description, fields: Sequence[str], place: str) -> None:
        """Set the FMU, its fields and the location of its key."""
        self._description = description
        self.fields, self.name, self.place = tuple(fields), description.path.name, place
        self._started: dict[str, float] | None = None
        self._longest: float | None = None

    def call(self, batch: StateBatch, way: Way, time: Unread | None = None) -> Array:
        """See :meth:`dashred.physics.external.adapter.Adapter.call`."""
        result = np.empty_like(batch.states)
        step = self._integrate if self._description.kind == MODEL_EXCHANGE else self._simulate
        parameters = self._known(batch.parameters)
        for row, state in enumerate(batch.states):
            inputs = self._known({name: v[row] for name, v in batch.inputs.items()})
            clock = float(batch.t[row]), float(batch.dt[row])
            # A state that blows up is reported as such, not as a warning of NumPy.
            with np.errstate(all="ignore"):
                result[row] = step(state, *clock, inputs, parameters)
        return result

    def sha256(self) -> str:
        """See :meth:`dashred.physics.external.adapter.Adapter.sha256`."""
        names = [variable.name for variable in self._description.fields]
        names += [f"{name}={v.name}" for name, v in self._description.others.items()]
        return files_sha256([*names, self._description.kind], [self._description.path])

    @cached_property
    def _instance(self) -> Instance:
        return Instance(self._description)

    @property
    def _has_memory(self) -> bool:
        """Whether the FMU must be initialised at each state: it has events, or discrete inputs."""
        others = self._description.others.values()
        discrete = any(v.causality == "input" and v.variability != "continuous" for v in others)
        return discrete or self._instance.has_events

    def _known(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters or inputs that the FMU has; the others are of the law."""
        return {k: float(v) for k, v in values.items() if k in self._description.others}

    def _start(self, t: float, state: Array, others: Mapping[str, float]) -> None:
        values: list[tuple[Any, float]] = [
            (self._description.others[name], value) for name, value in others.items()
        ]
        fields = zip(self._description.fields, map(float, state), strict=True)
        values += [(variable, x) for variable, x in fields if variable.initial in SETTABLE]
        self._instance.start(t, values)

    def _simulate(
        self, state: Array, t: float, dt: float, inputs: dict[str, float], parameters: Any
    ) -> Array:
        self._start(t, state, parameters | inputs)
        self._instance.do_step(t, dt)
        return self._instance.read_fields()

    def _integrate(
        self, state: Array, t: float, dt: float, inputs: dict[str, float], parameters: Any
    ) -> Array:
        order = list(self._description.order)
        x = np.empty(len(state))
        x[order] = state

        def run(steps: int) -> Array:
            if self._started != parameters or self._has_memory:
                self._start(t, state, parameters | inputs)
                self._started = dict(parameters)
            else:
                given = {self._description.others[name]: v for name, v in inputs.items()}
                self._instance.set_inputs(given)
            return integrate(self._instance, x, t, dt, steps)[order]

        if self._longest is None:
            self._longest = longest_step(run, dt)
        return run(max(1, math.ceil(dt / self._longest * (1 - 1e-9))))
