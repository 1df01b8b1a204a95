"""Free runs of the uncorrected and the corrected simulator through the recording and after it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.progress import stage
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import build_forcing
from dashred.inference.hypotheses.result import Discovery
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.held_out_episode import fit_starts
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import NominalRun

# Length of the forecast in lengths of the recording.
FORECAST = 0.5


@dataclass(frozen=True)
class Trajectories:
    """Free runs from the first sample; no data after the fit window is used.

    Attributes:
        times: times of the recording, then those of the forecast, ``(time,)``.
        recorded: number of times that belong to the recording.
        states: by method, ``(time, field, *grid)``: the uncorrected simulator from the start of
            the law (``simulation_same_start``) and from its own fitted start
            (``simulation_refit``), and the corrected simulator (``corrected``).
        others: free runs of the other fitted episodes.
        whole: free runs of the episodes that are held out as a whole.
    """

    times: Tensor
    recorded: int
    states: dict[str, Tensor]
    others: tuple[Trajectories, ...] = ()
    whole: tuple[Trajectories, ...] = ()

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
        starts = zip(problem.episodes, best.start, nothing.start, strict=True)
        first, *others = [
            _run(episode, best, start, refitted) for episode, start, refitted in starts
        ]
        whole = [_run(e, best, *fit_starts(e, nominal.prior, best)) for e in problem.whole]
    return replace(first, others=tuple(others), whole=tuple(whole))


def _run(problem: Problem, best: Law, start: Tensor, refitted: Tensor) -> Trajectories:
    """Run one episode with the law, and without it from the same start and from its own."""
    times = problem.times
    step = float((times[1:] - times[:-1]).median())
    ahead = round(FORECAST * float(times[-1] - times[0]) / step)
    forecast = times[-1] + step * torch.arange(1, ahead + 1, dtype=torch.float64)
    all_times = torch.cat([times, forecast])
    starts = torch.stack([start, refitted, start])
    none = torch.zeros((1, len(best.candidates)), dtype=torch.float64)
    coefficients = torch.cat([none, none, best.coefficients[None]])
    forcing = build_forcing(best.candidates, coefficients)
    same_start, refit, corrected = simulate(problem.system, starts, all_times, forcing)
    states = {
        "simulation_same_start": same_start,
        "simulation_refit": refit,
        "corrected": corrected,
    }
    return Trajectories(all_times, len(times), states)
