"""The base trajectory of an ODE system, stepped in plain numbers, with the state at every stage.

Of few unknowns an array operation costs what calling it costs: plain numbers take a tenth.
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

# ``(state, step, stage)`` to the rates of the fields.
Rates = Callable[[list[float], int, int], list[float]]
# ``(state, h, step, rates)`` to the states of the stages, and the next state.
Stepper = Callable[[list[float], float, int, Rates], tuple[list[list[float]], list[float]]]


def trajectory(
    tableau: Tableau,
    steps: Sequence[Step],
    start: Array,
    fields: Sequence[str],
    equations: Sequence[Expr],
    around: Mapping[str, Array],
    forced: Array,
) -> tuple[Array, Array]:
    """Return the states at every stage ``(step, stage, field)``, and at the output times.

    Args:
        tableau: the method.
        steps: its steps.
        start: ``(field,)``.
        fields: their names.
        equations: right-hand side of each field.
        around: time and inputs at every stage, ``(step, stage)``.
        forced: free forcing at every stage, ``(step, stage, field)``.
    """
    pushes = forced.tolist()
    now = np.stack(list(around.values()), axis=-1).tolist()
    names = [*fields, *around]
    program = scalar_program(equations, names)

    def by_numbers(state: list[float], i: int, stage: int) -> list[float]:
        found = program(*state, *now[i][stage])
        return [rate + push for rate, push in zip(found, pushes[i][stage], strict=True)]

    try:
        return _integrate(tableau, steps, start, by_numbers)
    except NON_FINITE_ERRORS:
        arrays = Pointwise(equations)

    def by_arrays(state: list[float], i: int, stage: int) -> list[float]:
        values = np.array([*state, *now[i][stage]])[:, None]
        found = arrays(dict(zip(names, values, strict=True)), (1,))[:, 0].tolist()
        return [rate + push for rate, push in zip(found, pushes[i][stage], strict=True)]

    return _integrate(tableau, steps, start, by_arrays)


def _integrate(
    tableau: Tableau, steps: Sequence[Step], start: Array, rates: Rates
) -> tuple[Array, Array]:
    advance = _stepper(tableau)
    y: list[float] = start.tolist()
    stages, saved = [], [y]
    for i, step in enumerate(steps):
        passed, y = advance(y, step.h, i, rates)
        stages.append(passed)
        if step.ends:
            saved.append(y)
    return np.array(stages).reshape(len(steps), len(tableau.b), len(start)), np.array(saved)


@cache
def _stepper(tableau: Tableau) -> Stepper:
    """Return a step of the method, written out: loops over its stages would cost a third more."""
    lines = ["def step(y, h, i, rates):"]
    for stage, shares in enumerate(tableau.a):
        lines += [f"y{stage} = {_moved(shares)}", f"k{stage} = rates(y{stage}, i, {stage})"]
    passed = ", ".join(f"y{stage}" for stage in range(len(tableau.a)))
    lines.append(f"return [{passed}], {_moved(tableau.b)}")
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
