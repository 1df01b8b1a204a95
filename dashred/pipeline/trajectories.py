"""Free runs of the uncorrected and the corrected simulator, over the recording and beyond."""

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
from dashred.pipeline.simulation import Nominal

# How long the forecast is, in lengths of the recording.
FORECAST = 0.5


@dataclass(frozen=True)
class Trajectories:
    """Free runs from the first sample on; nothing after the fit window has a part in them.

    Attributes:
        times: the recording's clock, and as many samples beyond it as the forecast takes.
        recorded: how many of them are the recording's.
        states: by method, ``(time, field, *grid)``: the uncorrected simulator from the law's
            start (``simulation_same_start``) and from its own best one (``simulation_refit``),
            and the corrected simulator (``corrected``).
        others: those of the other fitted episodes.
        whole: those of the episodes that are held out whole.
    """

    times: Tensor
    recorded: int
    states: dict[str, Tensor]
    others: tuple[Trajectories, ...] = ()
    whole: tuple[Trajectories, ...] = ()

    def over(self, samples: slice) -> dict[str, Tensor]:
        """Return the states over some samples."""
        return {name: states[samples] for name, states in self.states.items()}


@torch.no_grad()
def run_free(
    problem: Problem, nominal: Nominal, discovered: Discovery, seconds: dict[str, float]
) -> Trajectories:
    """Run all three in every episode; a run that blows up is not finite from then on."""
    best, nothing = discovered.best, discovered.uncorrected
    with stage("run free", seconds):
        found = [
            _run(episode, best, mine, alone)
            for episode, mine, alone in zip(
                problem.episodes,
                best.start,
                nothing.start,
                strict=True,
            )
        ]
        whole = [_run(e, best, *fit_starts(e, nominal.prior, best)) for e in problem.whole]
    return replace(found[0], others=tuple(found[1:]), whole=tuple(whole))


def _run(problem: Problem, best: Law, start: Tensor, refitted: Tensor) -> Trajectories:
    """Run one episode from the law's start, and without the law from that or its own."""
    times = problem.times
    step = float((times[1:] - times[:-1]).median())
    ahead = round(FORECAST * float(times[-1] - times[0]) / step)
    beyond = times[-1] + step * torch.arange(1, ahead + 1, dtype=torch.float64)
    clock = torch.cat([times, beyond])
    starts = torch.stack([start, refitted, start])
    none = torch.zeros((1, len(best.candidates)), dtype=torch.float64)
    coefficients = torch.cat([none, none, best.coefficients[None]])
    forcing = build_forcing(best.candidates, coefficients)
    same_start, refit, corrected = simulate(problem.system, starts, clock, forcing)
    states = {
        "simulation_same_start": same_start,
        "simulation_refit": refit,
        "corrected": corrected,
    }
    return Trajectories(clock, len(times), states)
