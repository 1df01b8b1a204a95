"""Energy loss of the corrected system per cycle."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag
from torch import Tensor

from dashred.core.findings.law_schema import EnergyLoss, Share
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import build_forcing
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

# Number of laws drawn from the posterior for the error bars.
DRAWS = 32


@torch.no_grad()
def energy_loss(
    system: System, law: Law, times: Tensor, rng: np.random.Generator
) -> EnergyLoss | None:
    """Return the share of energy that the corrected system loses in its first and last cycle.

    A cycle lies between two upward crossings of the mean by the first field; its share is
    ``1 - E(end)/E(begin)``. None if ``system.energy`` is not given, or if there is no complete
    cycle under the law or under any drawn law.

    Args:
        system: the simulator, with its ``energy``.
        law: the law.
        times: times of the simulation, ``(time,)``.
        rng: random generator for laws from the posterior; the fitted start is fixed.
    """
    if system.config.energy is None:
        return None
    candidates, mean = law.changes
    laws = torch.cat([mean[None], _draws(law, mean, rng)])
    starts = law.start[:1].expand(len(laws), *law.start.shape[1:])
    paths = simulate(system, starts, times, build_forcing(candidates, laws))
    # The energy may depend on fitted parameters.
    fitted = build_corrected_system(system, law)
    best, *drawn = (_shares(fitted, path, times.numpy()) for path in paths)
    with_cycles = [each for each in drawn if len(each)]
    if not len(best) or not with_cycles:
        return None
    spread = np.std([[each[0], each[-1]] for each in with_cycles], axis=0)
    return EnergyLoss(
        expression=system.config.energy,
        cycles=len(best),
        first=Share(lost=float(best[0]), std=float(spread[0])),
        last=Share(lost=float(best[-1]), std=float(spread[1])),
    )


def _draws(law: Law, mean: Tensor, rng: np.random.Generator) -> Tensor:
    """Return changes drawn from the posterior, ``(draw, parameter + candidate)``.

    Uncertain parameters are drawn independently of the law.
    """
    if not len(mean):
        return torch.zeros((1, 0), dtype=torch.float64)
    variances = np.diag([each.std**2 for each in law.parameters])
    covariance = block_diag(variances, law.covariance.numpy())
    drawn = rng.multivariate_normal(mean.numpy(), covariance, DRAWS, method="eigh")
    return torch.from_numpy(drawn)


def _shares(system: System, states: Tensor, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of energy lost in each cycle, ``(cycle,)``."""
    assert system.config.energy is not None
    energy = _mean(system.evaluate(system.config.energy, states))
    at = np.interp(_upward_crossings(_mean(states[:, 0]), times), times, energy)
    losses: NDArray[np.float64] = 1 - at[1:] / at[:-1]
    return losses


def _upward_crossings(
    values: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the times of upward crossings of the mean, by linear interpolation."""
    rest = values - values.mean()
    before = np.flatnonzero((rest[:-1] < 0) & (rest[1:] >= 0))
    share = rest[before] / (rest[before] - rest[before + 1])
    crossings: NDArray[np.float64] = times[before] + share * (times[before + 1] - times[before])
    return crossings


def _mean(values: Tensor) -> NDArray[np.float64]:
    """Return the mean over the grid, ``(time,)``."""
    return values.reshape(len(values), -1).mean(dim=1).numpy()
