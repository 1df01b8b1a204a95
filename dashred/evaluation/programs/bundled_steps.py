"""Steps of the bundled systems, as functions that know nothing of a law: ``bundled_steps.wave``.

The module is copied beside an analysis, which reads it as a user's own program. It counts its calls
in the current folder.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from functools import cache, partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.config import bundled_names, load_config
from dashred.physics.solvers.compiled.runge_kutta import CompiledRungeKutta
from dashred.physics.solvers.compiled_simulator import compile_system
from dashred.physics.solvers.schedule import round_up
from dashred.physics.system import System

Array = NDArray[np.float64]
Fields = Mapping[str, Array]
# Number of calls, number of states, and seconds inside of the functions.
TALLY = "calls.bin"


@torch.no_grad()
def _step(
    name: str, state: Fields, t: Array, dt: Array, inputs: Fields, parameters: object
) -> dict[str, Array]:
    """Step states ``(batch, *grid)`` by dt; t, dt and inputs have the shape ``(batch, *1)``."""
    began = time.perf_counter()
    count = len(dt)
    # Inputs are constant in a step, and are stepped as fields that do not change.
    stacked = [np.broadcast_to(values, (count, *values.shape[1:])) for values in inputs.values()]
    states = torch.from_numpy(np.stack([*state.values(), *stacked], axis=1))
    after = torch.empty_like(states)
    steps = dt.reshape(count)
    for h in np.unique(steps):
        rows = torch.from_numpy(steps == h)
        after[rows] = _flow(name)(states[rows], float(h))
    _tally()[:] += 1, count, time.perf_counter() - began
    return {field: after[:, i].numpy() for i, field in enumerate(state)}


@cache
def _tally() -> Array:
    return np.memmap(TALLY, np.float64, "w+", shape=(3,))


@cache
def _flow(name: str) -> Callable[[Tensor, float], Tensor]:
    """Return the flow of a bundled system: states ``(batch, field, *grid)`` and a time step."""
    loaded = load_config([f"conf={name}", "recording.twin=null"], entry="train")
    config = loaded.system
    system = System(
        dataclasses.replace(
            config,
            fields={**config.fields, **dict.fromkeys(config.inputs, "input")},
            equations={**config.equations, **dict.fromkeys(config.inputs, "0")},
            inputs={},
        ),
        loaded.where,
    )
    if system.axes:
        run, none = compile_system(system, ()), torch.zeros((1, 0), dtype=torch.float64)

        def run_fields(states: Tensor, h: float) -> Tensor:
            clock = torch.tensor([0.0, h], dtype=torch.float64)
            found = run(system.grid.ring(states), clock, none.expand(len(states), 0))
            return system.grid.own(found[:, -1])

        return run_fields
    one_step = CompiledRungeKutta(system, ()).flow(torch.zeros((1, 0), dtype=torch.float64), None)

    def run_ode(states: Tensor, h: float) -> Tensor:
        substeps = max(1, round_up(h / system.dt))
        for _ in range(substeps):
            states = one_step(states, 0.0, h / substeps)
        return states

    return run_ode


globals().update({name: partial(_step, name) for name in bundled_names()})
