"""Run a simulator: initial states → trajectories at output times."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress

import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.core.work import count_trajectories
from dashred.physics.cells.integrate import integrate_cells
from dashred.physics.expressions.semilinear import NotSemilinearError
from dashred.physics.external.failure import hint_of_failure
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.grids.transforms import modes_of, points_of
from dashred.physics.runge_kutta import THREE_EIGHTHS, Tableau, advance
from dashred.physics.solvers.adaptive import integrate_adaptive
from dashred.physics.solvers.etdrk4 import StepperCache
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import GridTendency, SpectralTendency
from dashred.physics.solvers.schedule import count_steps, schedule
from dashred.physics.solvers.splitting import AddedFlow, integrate_split
from dashred.physics.system import CPU, System

# An ODE runs in code that is compiled already; its programs cost as much as so many steps.
ODE_STEPS = 10
# With few trajectories, call overhead dominates: compilation saves time above MANY_STEPS steps.
FEW, MANY_STEPS = 8, 500
# Otherwise it saves time above this number of (point, step) pairs per second of compilation; the
# compilation takes SECONDS and SECONDS_PER_TERM for each term. All numbers are measured.
WORK_PER_SECOND, SECONDS, SECONDS_PER_TERM = 3e6, 1.5, 0.08
Progress = Callable[[float], None]
Tendency = Callable[[Tensor, float], Tensor]
OVERRUN_STEPS = 200


def simulate(
    system: System,
    start: Tensor,
    times: Tensor,
    forcing: Forcing | None = None,
    progress: Progress | None = None,
    sampled_forcing: SampledForcing | None = None,
    repeats: float = 1.0,
) -> Tensor:
    """Integrate ``∂u/∂t = N(u, t) + Σ ξ θ(u) + f(x, t)`` from ``times[0]`` on.

    Args:
        system: equations, grid and integrator.
        start: ``(batch, field, *grid)`` at ``times[0]``, float64.
        times: output times ``(time,)``, increasing, on the recording's clock.
        forcing: additional terms θ with coefficients ξ for each trajectory.
        progress: called with the fraction done after each output time.
        sampled_forcing: free forcing f of each trajectory.
        repeats: how often such a simulation is expected to run; compiled code is kept.

    Returns:
        ``(batch, time, field, *grid)``. After a blow-up, the values of a trajectory are not finite.
        A trajectory does not depend on the others in its batch, up to rounding errors. Adaptive
        methods (ODEs) choose their steps for the whole batch, so there it does up to the tolerance.
    """
    count_trajectories(len(start), count_steps(times.tolist(), system.dt), start[0].numel())
    if _should_compile(system, start, times, forcing, repeats):
        from dashred.physics.solvers.compiled.etdrk4 import integrate_etdrk4
        from dashred.physics.solvers.compiled.runge_kutta import integrate_runge_kutta

        if not system.axes:
            return integrate_runge_kutta(system, start, times, forcing, progress, sampled_forcing)
        # A term in a window may have no semilinear form; it is not compiled.
        with suppress(NotSemilinearError, ArithmeticError):
            if sampled_forcing is None:
                return integrate_etdrk4(system, start, times, forcing, progress)
    if system.program is not None:
        added = AddedFlow(system, forcing, sampled_forcing)
        changes = None if forcing is None else forcing.parameter_changes()
        whole = [*schedule(times.tolist(), system.dt, system.jumps)]
        states = integrate_split(system, added, start, whole, changes)
    elif system.spectral:
        tendency = tendency_on_device(system, forcing, sampled_forcing)
        states = _integrate_spectral(tendency, start.to(system.device), times.tolist())
    elif system.has_conditions:
        rates, steps = (
            GridTendency(system, forcing, sampled_forcing),
            schedule(times.tolist(), system.dt, system.jumps),
        )
        states = integrate_cells(system, rates, start, float(times[0]), steps)
    elif system.tableau is not None:
        explicit = GridTendency(system, forcing, sampled_forcing)
        states = _integrate_fixed(explicit, system.tableau, start, times.tolist(), system.dt)
    else:
        return _integrate_adaptive(system, start, times, forcing, sampled_forcing, progress)
    saved = []
    for index, state in enumerate(states):
        saved.append(state)
        if progress is not None:
            progress(index / max(1, len(times) - 1))
    return torch.stack(saved, dim=1).to(start.device)


def _should_compile(
    system: System, start: Tensor, times: Tensor, forcing: Forcing | None, repeats: float
) -> bool:
    if forcing is not None and forcing.coefficients.requires_grad:
        return False
    span = repeats * float(times[-1] - times[0])
    terms = 0 if forcing is None else len(forcing.terms)
    return is_compilation_worthwhile(system, start, span, terms)


def is_compilation_worthwhile(system: System, start: Tensor, span: float, terms: int) -> bool:
    """Return whether the runs are long enough to save the compilation time.

    Args:
        system: the simulator.
        start: initial states ``(batch, field, *grid)``.
        span: simulated time of all runs together.
        terms: number of additional terms that trajectories may have.
    """
    if system.device != CPU or start.requires_grad or system.program is not None:
        return False
    if not (system.spectral or (system.tableau is not None and not system.axes)):
        return False
    steps = span / system.dt
    if not system.axes:
        return steps > ODE_STEPS
    if len(start) <= FEW and terms <= FEW:
        return steps > MANY_STEPS and start.numel() * steps > WORK_PER_SECOND / 8
    return start.numel() * steps > compilation_work(terms)


def compilation_work(terms: int) -> float:
    """Return how many steps of a value take as long as a compilation with so many terms."""
    return WORK_PER_SECOND * (SECONDS + SECONDS_PER_TERM * terms)


def check_finite(trajectories: Tensor, times: Tensor, system: System) -> None:
    """Check that trajectories are finite.

    Raises:
        InputError: a trajectory blows up; the message names the time and the first fields.
    """
    finite = torch.isfinite(trajectories)
    if system.axes:
        finite = finite.flatten(3).all(dim=-1)
    if finite.all():
        return
    bad = (~finite).any(dim=0)
    time = int(torch.nonzero(bad.any(dim=-1))[0])
    fields = [f for f, is_bad in zip(system.fields, bad[time].tolist(), strict=True) if is_bad]
    verb = "is" if len(fields) == 1 else "are"
    hint = "use a smaller system.integrator.dt, more points, or look at the signs of its terms"
    raise InputError(
        f"the simulator blows up: {' and '.join(fields)} {verb} not finite at t = {times[time]:g}",
        where=system.where("system.equations"),
        hint=hint_of_failure(system.program, hint),
    )


def tendency_on_device(
    system: System, forcing: Forcing | None, sampled_forcing: SampledForcing | None
) -> SpectralTendency:
    """Return the tendency of a spectral system with its forcing on the system's device."""
    device = system.device
    law, sampled = forcing and forcing.to(device), sampled_forcing and sampled_forcing.to(device)
    return SpectralTendency(system, law, device, sampled)


def _integrate_spectral(
    tendency: SpectralTendency, start: Tensor, times: list[float]
) -> Iterator[Tensor]:
    grid = tendency.system.grid
    steppers = StepperCache(tendency.linear, tendency)
    state, modes = start, start
    yield state
    for step in schedule(times, tendency.system.dt, tendency.system.jumps):
        if step.begins:
            # Every interval starts from grid values. Rounding errors create modes that belong to no
            # real field. The equations do not see them, and a linear instability amplifies them.
            modes = tendency.dealias(modes_of(state, grid.shape))
        modes = steppers[step.h].step(modes, step.first, step.last)
        if step.ends:
            state = points_of(modes, grid.shape)
            yield state


def _integrate_fixed(
    tendency: GridTendency, tableau: Tableau, start: Tensor, times: list[float], dt: float
) -> Iterator[Tensor]:
    state = start
    yield state
    for step in schedule(times, dt, tendency.system.jumps):
        state = advance(tableau, tendency, state, step.t, step.h)
        if step.ends:
            yield state


def _integrate_adaptive(
    system: System,
    start: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    sampled_forcing: SampledForcing | None,
    progress: Progress | None,
) -> Tensor:
    if len(times) == 1:
        return start[:, None]
    tendency = GridTendency(system, forcing, sampled_forcing)
    begin, span = float(times[0]), float(times[-1] - times[0])

    def reported(state: Tensor, t: float) -> Tensor:
        if progress is not None:
            # Of an unknown number of steps; it is not done before the last one.
            progress(min(0.99, (t - begin) / span))
        return tendency(state, t)

    try:
        found = _adaptive(system, reported, start, times)
        if progress is not None:
            progress(1.0)
        return found
    except FloatingPointError:
        # One trajectory blows up: integrate each on its own, so that the others are not lost.
        trajectories = []
        for i in range(len(start)):
            row_forcing = sampled_forcing and sampled_forcing.row(i)
            row_tendency = GridTendency(system, _row(forcing, i), row_forcing)
            trajectories.append(_until_blow_up(row_tendency, start[i : i + 1], times))
        return torch.cat(trajectories)


def _adaptive(system: System, tendency: Tendency, start: Tensor, times: Tensor) -> Tensor:
    integrator = system.config.integrator
    tolerances = integrator.rtol, integrator.atol
    path = integrate_adaptive(tendency, start, times, system.method, *tolerances)
    return path.transpose(0, 1)


def _until_blow_up(tendency: GridTendency, start: Tensor, times: Tensor) -> Tensor:
    path = [start]
    for interval in times.unfold(0, 2, 1):
        try:
            path.append(_adaptive(tendency.system, tendency, path[-1], interval)[:, -1])
        except FloatingPointError:
            path.append(_integrate_past_blow_up(tendency, path[-1], interval))
            break
    lost = torch.full_like(start, torch.nan)
    return torch.stack(path + [lost] * (len(times) - len(path)), dim=1)


def _integrate_past_blow_up(tendency: GridTendency, state: Tensor, interval: Tensor) -> Tensor:
    """Integrate past a blow-up with fixed steps, to find the field that becomes infinite."""
    begin, end_time = interval.tolist()
    dt = (end_time - begin) / OVERRUN_STEPS
    *_, end = _integrate_fixed(tendency, THREE_EIGHTHS, state, [begin, end_time], dt)
    return torch.full_like(end, torch.nan) if torch.isfinite(end).all() else end


def _row(forcing: Forcing | None, i: int) -> Forcing | None:
    return forcing and Forcing(forcing.terms, forcing.coefficients[i : i + 1])
