"""Checks of the simulator: does it run, and is it resolved?"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.physics.external.failure import hint_of_failure
from dashred.physics.runs.initial_state_prior import (
    StartPrior,
    field_rms,
    fitted_modes,
    nominal_start,
)
from dashred.physics.runs.resolution import (
    doubling_error,
)
from dashred.physics.solvers.simulate import check_finite, simulate
from dashred.physics.system import System, Term
from dashred.physics.terms.collinear_terms import check_collinear, uninformative_terms
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.placeholders import zero_equations
from dashred.pipeline.check.remark import Remark, shortened, warning
from dashred.pipeline.check.simulator_checks.nodes import node_remarks
from dashred.pipeline.discovery.identifiable_terms import alike_on_readings
from dashred.pipeline.simulation.resolution_check import SensorTraces
from dashred.pipeline.simulation.state_samples import moved_states

# Time budgets of the nominal run and of the run at doubled resolution, in seconds.
NOMINAL_SECONDS, DOUBLED_SECONDS = 2.0, 3.0
# Samples of the timing run, after compilation, and the fewest samples of any run.
TIMED_SAMPLES = 6
MIN_SAMPLES = 3
# Changes below this share of the largest reading are rounding errors.
ROUNDING = 1e-9
# Mean over standard deviation of a field above which its square is linear to within a hundredth.
MAX_OFFSET = 25.0
# More excluded terms than this are listed without reasons.
FEW_TERMS = 6
# A jump of the start where a periodic axis closes, in units of its largest step between points.
SEAM_JUMP = 3.0
# Cost of doubled resolution beyond the number of points and steps: arrays exceed the cache.
DOUBLED_COST = 1.3


@dataclass(frozen=True)
class NominalRun:
    """The nominal run over as many samples as the time budget allows.

    Attributes:
        prior: prior of the initial state.
        states: ``(time, field, *grid)``.
        times: the first times of the clock, ``(time,)``.
        sample_seconds: run time per sample.
        blows_up: whether the run ends early because its values become infinite.
    """

    prior: StartPrior
    states: Tensor
    times: Tensor
    sample_seconds: float
    blows_up: bool = False

    def affordable_samples(self, seconds: float, cost_factor: float) -> int:
        """Return the number of samples that fit a budget at a relative cost per sample."""
        return _affordable_samples(seconds, self.sample_seconds * cost_factor, len(self.times))


@torch.no_grad()
def run_nominal(context: CheckContext) -> NominalRun:
    """Run the simulator from its nominal start.

    Raises:
        InputError: the simulation blows up.
    """
    system, times = context.system, context.times
    start = nominal_start(system)
    each, count = 0.0, 0
    # The first run compiles equations, which says nothing about the next. A program is run once.
    for _ in range(2 if system.program is None else 1):
        _, seconds = timed_simulation(system, start, times[:TIMED_SAMPLES])
        each = seconds / (len(times[:TIMED_SAMPLES]) - 1)
        count = _affordable_samples(NOMINAL_SECONDS, each, len(times))
        if count == len(times):
            break
    path, seconds = timed_simulation(system, start, times[:count])
    finite = _finite_samples(path[0])
    blows_up = MIN_SAMPLES <= finite < count
    if blows_up:
        # A run goes on along the readings. The last finite values are huge.
        count = max(MIN_SAMPLES, finite // 2)
        path = path[:, :count]
    check_finite(path, times[:count], system)
    prior = StartPrior(system, start[0], field_rms(path[0]), fitted_modes(system))
    sample_seconds = min(each, seconds / (count - 1))
    return NominalRun(prior, path[0], times[:count], sample_seconds, blows_up)


def _finite_samples(path: Tensor) -> int:
    """Return the number of samples before the first one that is not finite."""
    lost = ~path.flatten(1).isfinite().all(dim=1)
    return int(lost.int().argmax()) if bool(lost.any()) else len(path)


def timed_simulation(system: System, start: Tensor, times: Tensor) -> tuple[Tensor, float]:
    """Return a simulation and its run time in seconds."""
    started = time.perf_counter()
    path = simulate(system, start, times)
    return path, time.perf_counter() - started


def simulator_remarks(context: CheckContext, nominal: NominalRun) -> Iterator[Remark]:
    """Check that the simulated readings change and are resolved."""
    total, count = len(context.times), len(nominal.times)
    why = "" if nominal.blows_up else ", as far as time allows"
    within = "" if count == total else f" (the first {count} of {total} samples{why})"
    yield Remark(f"The simulation runs to t = {float(nominal.times[-1]):.6g}{within}")
    yield from _program_remarks(context)
    yield from node_remarks(context.system)
    if nominal.blows_up:
        program = context.system.program
        failure = None if program is None else program.failure
        yield warning(
            "The simulation blows up soon after that"
            if failure is None
            else f"The simulation fails soon after that: {failure}",
            "a run restarts it from the readings, or corrects it towards them",
        )
    sigma, limit = context.sigma(nominal.states), context.config.resolution_limit
    sensors = SensorTraces(context.sensors, sigma, limit)
    traces = sensors.read(context.system, nominal.states[None])[0]
    if not (traces.std(dim=0) > ROUNDING * traces.abs().max()).any():
        yield warning(
            "All simulated readings are constant",
            "check that the equations are written; if the simulator starts at rest, state the "
            "start of the recording if you know it, and how uncertain it is in system.spread",
        )
        return
    yield from _seam_remarks(context, nominal)
    yield _resolution_remark(context, nominal, sensors, traces)
    yield from _library_remarks(context, nominal)


def _program_remarks(context: CheckContext) -> Iterator[Remark]:
    """Say what a call of a program takes, and how many calls a simulation makes."""
    system, times = context.system, context.times
    if system.program is None:
        return
    calls = len(times[1:]) * max(1, round(float(times[1] - times[0]) / system.dt))
    seconds = system.program.seconds
    yield Remark(
        f"A call of the program takes {seconds:.2g} s; a simulation of the record "
        f"makes {calls} calls (about {calls * seconds:.2g} s)"
    )


def _library_remarks(context: CheckContext, nominal: NominalRun) -> Iterator[Remark]:
    """Yield terms that a run would refuse or exclude from the default library."""
    # Terms that a part of the record cannot separate may be separated by the whole of it.
    if len(nominal.times) < len(context.times) or zero_equations(context.config):
        return
    moved = moved_states(nominal.prior, nominal.states)
    arguments = context.system, context.library, nominal.states, nominal.times, moved
    try:
        if context.config.library is not None:
            check_collinear(*arguments)
        else:
            excluded = uninformative_terms(*arguments)
            if context.problem is not None:
                others = [term for term in context.library if term not in excluded]
                excluded |= alike_on_readings(context.problem, others)
            yield from _excluded_terms(excluded)
            yield from _large_offset_remarks(context, nominal)
    except InputError as error:
        yield Remark(f"{error.what}: their coefficients cannot be determined", "error", error.hint)


def _large_offset_remarks(context: CheckContext, nominal: NominalRun) -> Iterator[Remark]:
    """Warn of fields that vary too little about their mean for nonlinear terms.

    The readings of a field tell, if a sensor reads it: the simulator may lack what makes it vary.
    """
    fit, fields = context.split.fit, nominal.states.unbind(1)
    for name, simulated in zip(context.system.fields, fields, strict=True):
        own = [column for column, sensor in enumerate(fit.sensors) if sensor.reads == name]
        read = torch.from_numpy(fit.values[:, own if context.recording is not None else []])
        values = read[read.isfinite()] if read.isfinite().any() else simulated
        mean, std = float(values.mean()), float(values.std())
        if abs(mean) > MAX_OFFSET * std > 0:
            yield warning(
                f"{name} varies by {std:.2g} about {mean:.4g}: its powers and functions are nearly "
                "collinear",
                "list the candidate terms yourself (library:), or write the equations for the "
                "difference from the mean",
            )


def _excluded_terms(excluded: Mapping[Term, str | Term]) -> Iterator[Remark]:
    """Name the default terms that are excluded, and why if they are few."""
    if len(excluded) > FEW_TERMS:
        names = [f"{term} of {term.equation}" for term in excluded]
        yield Remark(
            f"{len(excluded)} default terms are excluded, which vanish here or are multiples of "
            f"others: {shortened(names)}"
        )
        return
    for term, why in excluded.items():
        reason = f"it {why} here" if isinstance(why, str) else f"it is a multiple of {why} here"
        yield Remark(f"The default term {term} of {term.equation} is excluded: {reason}")


def _seam_remarks(context: CheckContext, nominal: NominalRun) -> Iterator[Remark]:
    """Warn of fields whose nominal start jumps where a periodic axis closes."""
    system = context.system
    for dim, axis in enumerate(system.axes, start=1):
        if axis.ends != "periodic":
            continue
        for name, values in zip(system.fields, nominal.prior.centre, strict=True):
            steps = values.diff(dim=dim - 1).abs().amax()
            jump = (values.select(dim - 1, 0) - values.select(dim - 1, -1)).abs().amax()
            if float(jump) > SEAM_JUMP * float(steps):
                yield warning(
                    f"The start of {name} jumps by {float(jump):.3g} where the periodic axis "
                    f"{axis.name} closes",
                    f"does system.start.{name} have the length of the axis, {axis.length:g}, as "
                    "a period? Or are the ends not periodic?",
                )


@torch.no_grad()
def _resolution_remark(
    context: CheckContext, nominal: NominalRun, sensors: SensorTraces, traces: Tensor
) -> Remark:
    system, limit = context.system, sensors.limit
    cost_factor = DOUBLED_COST * 2.0 ** (1 + len(system.axes))
    count = nominal.affordable_samples(DOUBLED_SECONDS, cost_factor)
    times, start = nominal.times[:count], nominal.states[:1]
    least, coarse = sensors.least(traces), traces[None, :count]
    error, _ = doubling_error(system, start, times, sensors.read, coarse, least)
    if error > limit:
        # As in a run: a chaotic record amplifies any error, so those of short segments are added.
        error = min(error, sensors.over_segments(system, nominal.states[:count], times).error)
    span = f", over the first {count} samples" if count < len(context.times) else ""
    if not math.isfinite(error):
        how = "doubled resolution" if system.program is None else "half of the time step"
        hint = "decrease system.integrator.dt, or look at the equations"
        return Remark(
            f"It is not known whether the simulation is resolved: at {how} it does not stay "
            f"finite{span}",
            "error" if system.axes else "warning",
            hint_of_failure(system.program, hint),
        )
    done = "doubling the resolution" if system.program is None else "half of the time step"
    change = f"{done} changes a reading by {error:.2g} of its std{span}"
    if error <= limit:
        return Remark(f"The simulation is resolved: {change}")
    text = f"The simulation is not resolved: {change}, more than {limit:g}"
    why = "a run would find no law, because this error would look like missing physics"
    if system.axes:
        remedies = ["decrease system.integrator.dt", "increase the points of the axes"]
        if system.program is not None:
            remedies = remedies[:1]
        elif context.config.system.integrator.dt is None:
            # A step that was chosen is short enough.
            remedies = remedies[1:]
        remedy = ", or ".join(remedies)
        # Then a run may go on from smooth states along the readings.
        unless = "unless the simulator lacks what keeps its fields smooth"
        return Remark(text, "error", f"{why}, {unless}; {remedy}")
    # A run shortens the step of an ODE system, but by a limited factor.
    return warning(
        text, f"if half of the step is too long as well, {why}; decrease system.integrator.dt"
    )


def _affordable_samples(seconds: float, each: float, most: int) -> int:
    return max(min(MIN_SAMPLES, most), min(most, 1 + int(seconds / max(each, 1e-9))))
