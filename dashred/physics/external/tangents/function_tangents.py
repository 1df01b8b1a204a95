"""The tangents that a function in Python offers: ``jvp`` beside it, or as its attribute.

A state with a tangent, ``(u, δ) → (P(u), P'(u) δ)``, is stepped as any state is. So it is called,
examined and kept as that of a function with twice as many fields.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dashred.physics.external.state_batch import ProgramError

# Ends the name of a tangent; it contains a space, so that it is no field.
TANGENT = " tangent"
JVP = "jvp"


def with_tangents(fields: Sequence[str]) -> tuple[str, ...]:
    """Return the fields, then their tangents."""
    return (*fields, *(field + TANGENT for field in fields))


def find_jvp(function: Any, name: str) -> Callable[..., Any] | None:
    """Return ``function.jvp``, or ``jvp`` of the module of a function; None without one.

    A ``jvp`` that the module has imported from elsewhere, as from JAX, is another.
    """
    module = name.rpartition(".")[0]
    beside = getattr(sys.modules.get(module), JVP, None)
    if getattr(beside, "__module__", None) != module:
        beside = None
    found = getattr(function, JVP, None) or beside
    return found if callable(found) else None


def step_with_tangents(
    jvp: Callable[..., Any], fields: Sequence[str]
) -> Callable[..., Mapping[str, Any]]:
    """Return a jvp as a function that steps states with twice as many fields.

    Args:
        jvp: ``(state, t, dt, inputs, parameters, tangent)`` → the state after the step, and its
            tangent, as dictionaries of arrays by field.
        fields: of the system.
    """

    def step(state: Any, t: Any, dt: Any, inputs: Any, parameters: Any) -> Mapping[str, Any]:
        own = {name: state[name] for name in fields}
        tangent = {name: state[name + TANGENT] for name in fields}
        found = jvp(own, t, dt, inputs, parameters, tangent)
        if not (
            isinstance(found, tuple)
            and len(found) == 2
            and all(isinstance(part, Mapping) for part in found)
        ):
            hint = "return (state, tangent), both as dictionaries of fields"
            raise ProgramError(f"returns {type(found).__name__}, not a state and a tangent", hint)
        after, moved = found
        return {**after, **{name + TANGENT: values for name, values in moved.items()}}

    return step
