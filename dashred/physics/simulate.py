"""Run a simulator: a batch of starts → trajectories at the output times."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import torch
from torch import Tensor

from dashred.errors import InputError
from dashred.physics.forcing import Forcing
from dashred.physics.integrators.etdrk4 import ETDRK4
from dashred.physics.integrators.ode import (
    FIXED,
    integrate_adaptive,
    integrate_fixed,
    round_up,
    substeps,
)
from dashred.physics.integrators.ssprk3 import SSPRK3
from dashred.physics.system import System
from dashred.physics.tendency import GridTendency, SpectralTendency

Progress = Callable[[float], None]


def simulate(
    system: System,
    start: Tensor,
    times: Tensor,
    forcing: Forcing | None = None,
    progress: Progress | None = None,
) -> Tensor:
    """Integrate ``∂u/∂t = N(u, t) + Σ ξ θ(u)`` from ``times[0]`` on.

    Args:
        system: the equations, their grid and integrator.
        start: ``(batch, field, *grid)`` at ``times[0]``, float64.
        times: output times ``(time,)``, increasing, on the recording's clock.
        forcing: further terms with coefficients per trajectory.
        progress: called with the fraction done after every output time.

    Returns:
        ``(batch, time, field, *grid)``. A trajectory that blows up is not finite from then on.
    """
    if not system.axes:
        return _integrate_ode(system, start, times, forcing)
    march = _spectral_march if system.spectral else _grid_march
    saved = []
    for index, state in enumerate(march(system, start, times.tolist(), forcing)):
        saved.append(state)
        if progress is not None:
            progress(index / max(1, len(times) - 1))
    return torch.stack(saved, dim=1)


def check_finite(trajectories: Tensor, times: Tensor, system: System) -> None:
    """Refuse a simulator that blows up.

    Raises:
        InputError: says when, and in which field first.
    """
    finite = torch.isfinite(trajectories).flatten(3).all(dim=-1) if system.axes else (
        torch.isfinite(trajectories)
    )
    if finite.all():
        return
    bad = (~finite).any(dim=0)
    time = int(torch.nonzero(bad.any(dim=-1))[0])
    fields = [f for f, is_bad in zip(system.fields, bad[time].tolist(), strict=True) if is_bad]
    raise InputError(
        f"the simulator blows up: {', '.join(fields)} is not finite at t = {times[time]:g}",
        where=system.where("system.equations"),
        hint="use a smaller system.integrator.dt, more points, or look at the signs of its terms",
    )


def _spectral_march(
    system: System, start: Tensor, times: list[float], forcing: Forcing | None
) -> Iterator[Tensor]:
    grid = system.grid
    tendency = SpectralTendency(system, forcing, start.device)
    steppers: dict[float, ETDRK4] = {}
    modes = torch.fft.rfftn(start, dim=grid.dims)
    yield start
    for begin, end in zip(times[:-1], times[1:], strict=True):
        count = max(1, round_up((end - begin) / system.dt))
        h = round((end - begin) / count, 12)
        if h not in steppers:
            steppers[h] = ETDRK4(tendency.linear, tendency, h)
        for i in range(count):
            modes = steppers[h].step(modes, begin + i * h)
        yield torch.fft.irfftn(modes, s=grid.shape, dim=grid.dims)


def _grid_march(
    system: System, start: Tensor, times: list[float], forcing: Forcing | None
) -> Iterator[Tensor]:
    tendency = GridTendency(system, forcing)
    state = start
    yield state
    for begin, end in zip(times[:-1], times[1:], strict=True):
        count = max(1, round_up((end - begin) / system.dt))
        stepper = SSPRK3(tendency, (end - begin) / count)
        for i in range(count):
            state = stepper.step(state, begin + i * stepper.h)
        yield state


def _integrate_ode(
    system: System, start: Tensor, times: Tensor, forcing: Forcing | None
) -> Tensor:
    tendency = GridTendency(system, forcing)
    if len(times) == 1:
        return start[:, None]
    if system.method in FIXED:
        steps = substeps(times, system.dt)
        path = integrate_fixed(tendency, start, times, system.method, steps)
    else:
        integrator = system.config.integrator
        path = _until_underflow(
            lambda: integrate_adaptive(
                tendency, start, times, system.method, integrator.rtol, integrator.atol
            ),
            like=start.new_full((len(times), *start.shape), np.nan),
        )
    return path.transpose(0, 1)


def _until_underflow(solve: Callable[[], Tensor], like: Tensor) -> Tensor:
    try:
        return solve()
    except FloatingPointError:
        return like
