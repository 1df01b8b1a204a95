"""Free runs of the uncorrected and the corrected simulator through the recording and after it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.progress import stage
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import build_forcing
from dashred.inference.hypotheses.result import Discovery
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.runs.bounded_step import BoundedStep, bounded_step
from dashred.physics.runs.initial_state_prior import field_rms
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.held_out_episode import fit_starts
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun

# Length of the forecast in lengths of the recording.
FORECAST = 0.5
# A second run begins at the fitted start, moved towards the nominal start by this share.
SHIFT = 1e-7
# A larger difference of two runs, in rms of the fields, does not grow exponentially.
LINEAR = 1e-2
# If an error of the start grows by more than this factor over the record, forecasts of a free run
# are lost before its end.
UNPREDICTABLE_GROWTH = 50.0


@dataclass(frozen=True)
class Trajectories:
    """Free runs from the first sample; no data after the fit window is used.

    Attributes:
        times: times of the recording, then those of the forecast, ``(time,)``.
        recorded: number of times that belong to the recording.
        states: by method, ``(time, field, *grid)``: the uncorrected simulator from the start of
            the law (``simulation_same_start``) and from its own fitted start
            (``simulation_refit``), and the corrected simulator (``corrected``). Without a law, the
            first is the simulator from its nominal start. Uncertain parameters are as fitted
            with the law, without it, and with it; without a law they are as stated in the first.
        growth_rate: rate at which a small error of the start of the corrected simulator grows, in
            1/time; an estimate of the largest Lyapunov exponent.
        dt: a shorter time step, with which the corrected simulator was run because its own is
            unstable; None if it is stable.
        diverges: time at which the corrected simulator leaves all bounds, with shorter time steps
            as well; None if it does not, or if it is a program.
        others: free runs of the other fitted episodes.
        whole: free runs of the episodes that are held out as a whole.
    """

    times: Tensor
    recorded: int
    states: dict[str, Tensor]
    growth_rate: float
    dt: float | None = None
    diverges: float | None = None
    others: tuple[Trajectories, ...] = ()
    whole: tuple[Trajectories, ...] = ()

    @property
    def every(self) -> tuple[Trajectories, ...]:
        """The runs of all episodes."""
        return (self, *self.others, *self.whole)

    @property
    def shortest_dt(self) -> float | None:
        """The time step with which the corrected simulator is stable in every episode."""
        return min((run.dt for run in self.every if run.dt is not None), default=None)

    @property
    def first_diverges(self) -> float | None:
        """Time at which the corrected simulator diverges first, of all episodes."""
        return min((run.diverges for run in self.every if run.diverges is not None), default=None)

    def over(self, samples: slice) -> dict[str, Tensor]:
        """Return the states of the given samples by method."""
        return {name: states[samples] for name, states in self.states.items()}


@torch.no_grad()
def simulate_trajectories(
    problem: Problem, nominal: NominalRun, discovery: Discovery, seconds: dict[str, float]
) -> Trajectories:
    """Run the three methods in every episode; a run that blows up is not finite afterwards."""
    best, nothing = discovery.best, discovery.uncorrected
    with stage("free runs", seconds):
        nominal_starts = [path[0] for path in (nominal.states, *nominal.others)]
        first, *others = [
            _run(episode, best, nothing, *starts)
            for episode, *starts in zip(
                problem.episodes, best.start, nothing.start, nominal_starts, strict=True
            )
        ]
        whole = [
            _run(
                episode,
                best,
                nothing,
                *fit_starts(episode, nominal.prior, best, nothing),
                path[0],
            )
            for episode, path in zip(problem.whole, nominal.whole, strict=True)
        ]
    return replace(first, others=tuple(others), whole=tuple(whole))


def _run(
    problem: Problem, best: Law, nothing: Law, start: Tensor, refitted: Tensor, nominal: Tensor
) -> Trajectories:
    """Run one episode with the law, and without it from several starts.

    Args:
        problem: the episode.
        best: the law.
        nothing: the empty law.
        start: fitted start with the law, ``(field, *grid)``.
        refitted: fitted start without it.
        nominal: start of the simulator as it is configured.
    """
    times = problem.times
    interval = float((times[1:] - times[:-1]).median())
    ahead = round(FORECAST * float(times[-1] - times[0]) / interval)
    forecast = times[-1] + interval * torch.arange(1, ahead + 1, dtype=torch.float64)
    all_times = torch.cat([times, forecast])
    # A start that is known exactly equals the nominal one.
    shift = SHIFT * (nominal - start if bool((nominal != start).any()) else start)
    uncorrected = start if best.candidates else nominal
    starts = torch.stack([uncorrected, refitted, start, start + shift])
    none, (candidates, law) = torch.zeros_like(best.coefficients), best.changes
    without, refitted_without = (
        torch.cat([each.parameter_changes, none]) for each in (best, nothing)
    )
    forcing = build_forcing(candidates, torch.stack([without, refitted_without, law, law]))
    same_start, refit, corrected, shifted = simulate(problem.system, starts, all_times, forcing)
    rate = _growth_rate(times, corrected[: len(times)], shifted[: len(times)])
    step = BoundedStep()
    if best.candidates and problem.system.program is None:
        # The run above may blow up although this one does not: with conditions at the ends, the
        # linear terms of a system set no limit to the step
        # (:mod:`dashred.physics.cells.integrate`), but those of a forcing do.
        system = build_corrected_system(problem.system, best)
        step = bounded_step(system, start, all_times, len(times))
    if best.parameters and not best.candidates:
        [same_start] = simulate(problem.stated_system, nominal[None], all_times)
    states = {
        "simulation_same_start": same_start,
        "simulation_refit": refit,
        "corrected": corrected if step.states is None else step.states,
    }
    return Trajectories(all_times, len(times), states, rate, step.dt, step.diverges)


def _growth_rate(times: Tensor, states: Tensor, shifted: Tensor) -> float:
    """Return the slope of the logarithm of the difference of two runs, ``(time, field, *grid)``.

    The difference is in units of the rms of each field. Times after it first exceeds
    :data:`LINEAR` are not used. It is 0 if a run blows up before.
    """
    rms = field_rms(states)
    unit = torch.where(rms > 0, rms, 1.0).reshape(-1, *[1] * (states.dim() - 2))
    size = ((shifted - states) / unit).flatten(1).square().mean(dim=1).sqrt()
    is_large = ~(size < LINEAR)
    count = int(is_large.int().argmax()) if is_large.any() else len(size)
    if count < 3 or not size[:count].all():
        return 0.0
    passed, logarithm = times[:count] - times[:count].mean(), size[:count].log()
    return float(passed @ logarithm / (passed @ passed))
