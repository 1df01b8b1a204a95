"""Integrate an ODE system in Python floats and save the state at each Runge-Kutta stage.

With few unknowns, call overhead dominates array operations. Floats take a tenth of the time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from dashred.physics.backends.codegen import define
from dashred.physics.backends.numpy_backend import Array, Pointwise
from dashred.physics.backends.scalar_backend import NON_FINITE_ERRORS, scalar_program
from dashred.physics.expressions.algebra import Expr
from dashred.physics.runge_kutta import Tableau
from dashred.physics.solvers.schedule import Step

# ``(state, step, stage)`` → rates of the fields.
Rates = Callable[[list[float], int, int], list[float]]
# ``(state, h, step, rates)`` → states of the stages, and the next state.
Stepper = Callable[[list[float], float, int, Rates], tuple[list[list[float]], list[float]]]


def trajectory(
    tableau: Tableau,
    steps: Sequence[Step],
    start: Array,
    fields: Sequence[str],
    equations: Sequence[Expr],
    inputs: Mapping[str, Array],
    forced: Array,
) -> tuple[Array, Array]:
    """Return the states at the stages, ``(step, stage, field)``, and at the output times.

    Args:
        tableau: the method.
        steps: the time steps.
        start: initial state ``(field,)``.
        fields: names of the fields.
        equations: right-hand side of each field.
        inputs: time and inputs at each stage by name, ``(step, stage)`` each.
        forced: free forcing at each stage, ``(step, stage, field)``.
    """
    forcing = forced.tolist()
    input_values = np.stack(list(inputs.values()), axis=-1).tolist()
    names = [*fields, *inputs]
    program = scalar_program(equations, names)

    def scalar_rates(state: list[float], i: int, stage: int) -> list[float]:
        result = program(*state, *input_values[i][stage])
        return [rate + f for rate, f in zip(result, forcing[i][stage], strict=True)]

    try:
        return _integrate(tableau, steps, start, scalar_rates)
    except NON_FINITE_ERRORS:
        arrays = Pointwise(equations)

    def array_rates(state: list[float], i: int, stage: int) -> list[float]:
        values = np.array([*state, *input_values[i][stage]])[:, None]
        result = arrays(dict(zip(names, values, strict=True)), (1,))[:, 0].tolist()
        return [rate + f for rate, f in zip(result, forcing[i][stage], strict=True)]

    return _integrate(tableau, steps, start, array_rates)


def _integrate(
    tableau: Tableau, steps: Sequence[Step], start: Array, rates: Rates
) -> tuple[Array, Array]:
    advance = _stepper(tableau)
    y: list[float] = start.tolist()
    stages, saved = [], [y]
    for i, step in enumerate(steps):
        stage_states, y = advance(y, step.h, i, rates)
        stages.append(stage_states)
        if step.ends:
            saved.append(y)
    return np.array(stages).reshape(len(steps), len(tableau.b), len(start)), np.array(saved)


@cache
def _stepper(tableau: Tableau) -> Stepper:
    """Return a step of the method as generated code; loops over its stages cost a third more."""
    lines = ["def step(y, h, i, rates):"]
    for stage, shares in enumerate(tableau.a):
        lines += [f"y{stage} = {_stage_code(shares)}", f"k{stage} = rates(y{stage}, i, {stage})"]
    states = ", ".join(f"y{stage}" for stage in range(len(tableau.a)))
    lines.append(f"return [{states}], {_stage_code(tableau.b)}")
    scope: dict[str, Any] = {}
    define("\n    ".join(lines), scope)
    step: Stepper = scope["step"]
    return step


def _stage_code(shares: Sequence[float]) -> str:
    """Return the code of ``y + h Σ_j shares_j k_j``."""
    read = {j: share for j, share in enumerate(shares) if share}
    if not read:
        return "y"
    total = " + ".join(f"{share!r} * r{j}" for j, share in read.items())
    rates = "".join(f", r{j}" for j in read)
    columns = "".join(f", k{j}" for j in read)
    return f"[v + h * ({total}) for v{rates} in zip(y{columns})]"
