"""The simulator itself, within a budget of seconds: does it run, and is it resolved?"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.data.observation_operator import ObservationOperator
from dashred.physics.library import check_collinear, uninformative_terms
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.runs.resolution import Readings, doubling_error, minimum_scale
from dashred.physics.solvers.simulate import check_finite, simulate
from dashred.physics.system import System, Term
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.placeholders import still
from dashred.pipeline.check.remark import Remark, doubtful

# Seconds for the nominal run, and for the run at doubled resolution.
RUN, DOUBLED = 2.0, 3.0
# Samples whose run tells how long the others take; compiling is in neither.
PROBED = 6
FEWEST = 3
# Of what it reads, a share below which changes are rounding.
STILL = 1e-9
# A mean so many times what a field varies by: its square is a straight line but for a hundredth.
FAR_FROM_ZERO = 25.0
# Twice the points along every axis and twice the steps, and a little for what is larger than a
# cache.
DEARER = 1.3


@dataclass(frozen=True)
class Simulated:
    """The simulator's nominal run over the samples that there was time for.

    Attributes:
        prior: what is known of the start.
        states: ``(time, field, *grid)``.
        times: their times, the first ones of the clock.
        sample_seconds: how long one sample takes.
    """

    prior: StartPrior
    states: Tensor
    times: Tensor
    sample_seconds: float

    def affordable(self, seconds: float, dearer: float) -> int:
        """Return how many samples of what is so much dearer there are seconds for."""
        return _affordable(seconds, self.sample_seconds * dearer, len(self.times))


@torch.no_grad()
def run_nominal(situation: CheckContext) -> Simulated:
    """Run the simulator from its established start.

    Raises:
        InputError: it blows up.
    """
    system, times = situation.system, situation.times
    start = nominal_start(system)
    probed = simulate_timed(system, start, times[:PROBED])
    each = probed[1] / (len(times[:PROBED]) - 1)
    count = _affordable(RUN, each, len(times))
    path, seconds = simulate_timed(system, start, times[:count])
    check_finite(path, times[:count], system)
    modes = system.config.spread.get("modes")
    prior = StartPrior(system, start[0], field_rms(path[0]), None if modes is None else int(modes))
    return Simulated(prior, path[0], times[:count], min(each, seconds / (count - 1)))


def simulate_timed(system: System, start: Tensor, times: Tensor) -> tuple[Tensor, float]:
    """Return a simulation, and how many seconds it took."""
    began = time.perf_counter()
    path = simulate(system, start, times)
    return path, time.perf_counter() - began


def about_simulator(situation: CheckContext, simulated: Simulated) -> Iterator[Remark]:
    """Say whether it moves, and whether it is resolved."""
    total, count = len(situation.times), len(simulated.times)
    within = "" if count == total else f" (the first {count} of {total} samples)"
    yield Remark(f"It runs from its start to t = {float(simulated.times[-1]):.6g}{within}")
    readings = _readings(situation)
    traces = readings(situation.system, simulated.states[None])[0]
    if not (traces.std(dim=0) > STILL * traces.abs().max()).any():
        yield doubtful("In it nothing moves that a sensor reads", "are its equations written?")
        return
    yield _resolution(situation, simulated, traces)
    yield from _library(situation, simulated)


def _library(situation: CheckContext, simulated: Simulated) -> Iterator[Remark]:
    """Tell of terms that a run would refuse, or leave out of the default library."""
    # Those that a part of the record cannot tell apart the whole of it may.
    if len(simulated.times) < len(situation.times) or still(situation.config):
        return
    own = situation.config.library is not None
    terms = situation.system, situation.library, simulated.states, simulated.times
    try:
        if own:
            check_collinear(*terms)
        else:
            yield from map(_left_out, uninformative_terms(*terms).items())
            yield from _far_from_zero(situation, simulated)
    except InputError as error:
        yield Remark(f"{error.what}: no data could tell their coefficients", "wrong", error.hint)


def _far_from_zero(situation: CheckContext, simulated: Simulated) -> Iterator[Remark]:
    """Tell of fields whose powers and functions are hardly more than straight lines."""
    fields = simulated.states.unbind(1)
    for name, values in zip(situation.system.fields, fields, strict=True):
        mean, std = float(values.mean()), float(values.std())
        if abs(mean) > FAR_FROM_ZERO * std > 0:
            yield doubtful(
                f"{name} varies by {std:.2g} about {mean:.4g}: powers and functions of it are hard "
                "to tell apart",
                "list the candidate terms yourself (library:), or write the equations in what it "
                "differs by from there",
            )


def _left_out(term_and_why: tuple[Term, str | Term]) -> Remark:
    term, why = term_and_why
    told = f"it {why} here" if isinstance(why, str) else f"it is {why} here, up to a number"
    return Remark(f"Of the default terms of {term.equation}, {term} is left out: {told}")


@torch.no_grad()
def _resolution(situation: CheckContext, simulated: Simulated, traces: Tensor) -> Remark:
    system, limit = situation.system, situation.config.resolution_limit
    dearer = DEARER * 2.0 ** (1 + len(system.axes))
    count = simulated.affordable(DOUBLED, dearer)
    times, start = simulated.times[:count], simulated.states[:1]
    readings = _readings(situation)
    reads = [sensor.reads for sensor in situation.sensors]
    least = minimum_scale(traces, situation.sigma(simulated.states), reads, limit)
    error, _ = doubling_error(system, start, times, readings, traces[None, :count], least)
    span = f", over the first {count} samples" if count < len(situation.times) else ""
    moves = f"twice its resolution moves a sensor's trace by {error:.2g} of its std{span}"
    if error <= limit:
        return Remark(f"It is resolved: {moves}")
    return doubtful(
        f"It is not resolved: {moves}; more than {limit:g}",
        f"a run refuses it: its error would pass for missing physics. {_remedy(system)}",
    )


def _remedy(system: System) -> str:
    if not system.axes:
        return "Make system.integrator.dt smaller"
    return "Make system.integrator.dt smaller, or the axes' points more"


def _readings(situation: CheckContext) -> Readings:
    sensors = situation.sensors

    def readings(system: System, states: Tensor) -> Tensor:
        return ObservationOperator(sensors, system)(states)

    return readings


def _affordable(seconds: float, each: float, most: int) -> int:
    return max(min(FEWEST, most), min(most, 1 + int(seconds / max(each, 1e-9))))
