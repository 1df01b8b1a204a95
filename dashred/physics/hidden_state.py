"""A state that is not in the equations, follows one of their quantities and acts back on them.

It relaxes toward a quantity u with a time constant τ, as the wall of a mug follows the water::

    z' = (u - z)/τ        z(0) = u(0)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dashred.physics import system_schema as schema
from dashred.physics.expressions import algebra
from dashred.physics.external.stepped_fields import stepped_fields
from dashred.physics.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HiddenState:
    """A hidden state z and its time constant.

    Attributes:
        name: of z, as a field.
        constant: name of τ, as a parameter.
        follows: name of u, a field or an input.
        tau: value of τ.
        start: z at the first sample, as a number or an expression in parameters.
        spread: prior standard deviation of the start.
        tau_spread: prior standard deviation of τ; 0 for a known τ.
    """

    name: str
    constant: str
    follows: str
    tau: float
    start: str
    spread: float
    tau_spread: float = 0.0

    @property
    def equation(self) -> str:
        """The right-hand side of ``z'``."""
        return f"({self.follows} - {self.name})/{self.constant}"


def with_hidden_states(config: schema.System, states: Sequence[HiddenState]) -> schema.System:
    """Return a system with hidden states as further fields, which do not act on the others yet.

    A declared port-Hamiltonian structure is left out, because it does not contain them.

    Args:
        config: the system.
        states: with names that are not in use.
    """
    units = dict(config.units)
    for each in states:
        own = {each.name: config.units.get(each.follows), each.constant: config.units.get("t")}
        units |= {name: unit for name, unit in own.items() if unit}
    spreads = {s.constant: s.tau_spread for s in states if s.tau_spread}
    simulator = config.simulator
    if simulator is not None:
        simulator = replace(simulator, fields=list(stepped_fields(config)))
    return replace(
        config,
        simulator=simulator,
        fields={
            **config.fields,
            **{s.name: f"hidden state that follows {s.follows}" for s in states},
        },
        parameters={**config.parameters, **{s.constant: s.tau for s in states}},
        parameter_spread={**config.parameter_spread, **spreads},
        equations={**config.equations, **{s.name: s.equation for s in states}},
        start={**config.start, **{s.name: s.start for s in states}},
        spread={**config.spread, **{s.name: s.spread for s in states}},
        structure=None,
        units=units,
    )


def without_hidden_state(config: schema.System, state: HiddenState) -> schema.System:
    """Return a system without a hidden state that does not act on the others."""

    def others(section: dict[str, Any]) -> dict[str, Any]:
        return {k: v for k, v in section.items() if k not in (state.name, state.constant)}

    return replace(
        config,
        fields=others(config.fields),
        parameters=others(config.parameters),
        parameter_spread=others(config.parameter_spread),
        equations=others(config.equations),
        start=others(config.start),
        spread=others(config.spread),
        units=others(config.units),
    )


def followed_by(system: System, field: str) -> str | None:
    """Return the quantity u that a field relaxes toward, as in ``z' = (u - z)/τ``; None if none."""
    read, known = algebra.names(system.equations[field]), system.config.parameters
    others = [name for name in read if name not in known and name != field]
    constants = [name for name in read if name in known]
    if len(others) != 1 or len(constants) != 1:
        return None
    relaxes = HiddenState(field, constants[0], others[0], 1.0, "0", 0.0).equation
    same = system.parse(relaxes, f"system.equations.{field}", equation=field)
    return others[0] if system.equations[field] == same else None


def relax(times: Array, follows: Array, tau: float) -> Array:
    """Return z at some times, exactly for a quantity u that is linear between them.

    Args:
        times: increasing, ``(time,)``.
        follows: u at these times, ``(time,)``.
        tau: τ.
    """
    z = np.empty_like(follows)
    z[0] = follows[0]
    for k, step in enumerate(np.diff(times)):
        lag = tau * (follows[k + 1] - follows[k]) / step
        z[k + 1] = follows[k + 1] - lag + (z[k] - follows[k] + lag) * np.exp(-step / tau)
    return z
