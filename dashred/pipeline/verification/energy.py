"""How much energy the corrected system loses, cycle by cycle."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.core.findings.law_schema import EnergyLost, Share
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import forcing_of
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

# Laws drawn from the posterior for the error bars.
DRAWS = 32


@torch.no_grad()
def energy_lost(
    system: System, law: Law, times: Tensor, rng: np.random.Generator
) -> EnergyLost | None:
    """Return what share of its energy the corrected system loses in its first and last cycle.

    A cycle lies between two upward passages of the first field through its mean, and its share is
    ``1 - E(end)/E(begin)``. Null where ``system.energy`` is, and where there is no whole cycle,
    or none under any law that is drawn.

    Args:
        system: the simulator; its ``energy`` is meant.
        law: what it leaves out.
        times: how long to look, ``(time,)``.
        rng: draws laws from the posterior for the error bars, the fitted start kept.
    """
    if system.config.energy is None:
        return None
    laws = torch.cat([law.coefficients[None], _draws(law, rng)])
    starts = law.start[:1].expand(len(laws), *law.start.shape[1:])
    paths = simulate(system, starts, times, forcing_of(law.candidates, laws))
    best, *drawn = (_shares(system, path, times.numpy()) for path in paths)
    swung = [each for each in drawn if len(each)]
    if not len(best) or not swung:
        return None
    spread = np.std([[each[0], each[-1]] for each in swung], axis=0)
    return EnergyLost(
        expression=system.config.energy,
        cycles=len(best),
        first=Share(lost=float(best[0]), std=float(spread[0])),
        last=Share(lost=float(best[-1]), std=float(spread[1])),
    )


def _draws(law: Law, rng: np.random.Generator) -> Tensor:
    """Return coefficients drawn from the posterior, ``(draw, candidate)``."""
    mean, covariance = law.coefficients.numpy(), law.covariance.numpy()
    if not law.candidates:
        return torch.zeros((1, 0), dtype=torch.float64)
    return torch.from_numpy(rng.multivariate_normal(mean, covariance, DRAWS, method="eigh"))


def _shares(system: System, states: Tensor, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of its energy that each cycle loses, ``(cycle,)``."""
    assert system.config.energy is not None
    energy = _mean(system.evaluate(system.config.energy, states))
    at = np.interp(_passages(_mean(states[:, 0]), times), times, energy)
    found: NDArray[np.float64] = 1 - at[1:] / at[:-1]
    return found


def _passages(values: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return when values pass their mean upwards, between samples by a straight line."""
    rest = values - values.mean()
    before = np.flatnonzero((rest[:-1] < 0) & (rest[1:] >= 0))
    share = rest[before] / (rest[before] - rest[before + 1])
    found: NDArray[np.float64] = times[before] + share * (times[before + 1] - times[before])
    return found


def _mean(values: Tensor) -> NDArray[np.float64]:
    """Return the mean over the grid, ``(time,)``."""
    return values.reshape(len(values), -1).mean(dim=1).numpy()
