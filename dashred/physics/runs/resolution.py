"""Is the simulator resolved? Double its resolution and see whether its readings move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.physics.solvers.simulate import Progress, simulate
from dashred.physics.system import System

Readings = Callable[[System, Tensor], Tensor]
# An error of the simulator that is this share of the noise biases nothing (design §4.2.7).
FAINT = 0.1


@dataclass(frozen=True)
class Resolution:
    """What doubling the resolution in space and time changes at the sensors.

    Attributes:
        error: largest rms change of a sensor's trace, in units of that trace's std, or of what
            :func:`least_scale` has in its place.
        limit: the change that may be.
        enough: factor of refinement at which the change falls below the limit; None if no
            factor tried does.
    """

    error: float
    limit: float
    enough: int | None

    @property
    def resolved(self) -> bool:
        """Whether the simulator may be trusted to the limit."""
        return self.error <= self.limit


def refine(system: System, start: Tensor) -> tuple[System, Tensor]:
    """Return the system at doubled resolution, and a start ``(1, field, *grid)`` on its grid."""
    finer = system.refined()
    return finer, system.grid.interpolate(start, finer.grid) if system.axes else start


def least_scale(
    traces: Float[Tensor, "time sensor"],
    noise: Float[Tensor, " sensor"],
    reads: Sequence[str],
    limit: float,
) -> Float[Tensor, " sensor"]:
    """Return what the change of a trace that hardly moves is held against, in place of its std.

    That of which the limit is a tenth of the noise, ``σ/(10·limit)``, but no more than the median
    std of the traces that read the same, in case the noise is said to be larger than it is.

    Args:
        traces: of a simulation.
        noise: σ of every sensor.
        reads: what it reads.
        limit: share of a trace's std by which it may change.
    """
    std = traces.std(dim=0)
    typical = {kind: std[[r == kind for r in reads]].quantile(0.5) for kind in set(reads)}
    return torch.minimum(FAINT / limit * noise, torch.stack([typical[kind] for kind in reads]))


@torch.no_grad()
def doubling_error(
    system: System,
    start: Tensor,
    times: Tensor,
    readings: Readings,
    coarse: Tensor,
    least: Tensor,
    progress: Progress | None = None,
) -> tuple[float, Tensor]:
    """Compare the readings of a simulation with those at doubled resolution.

    Args:
        system: the simulator.
        start: ``(1, field, *grid)``, interpolated to the finer grid.
        times: output times.
        readings: (system, trajectory) → traces ``(batch, time, sensor)``.
        coarse: readings of the system itself.
        least: what the change of a trace is held against at least, ``(sensor,)``.
        progress: called with the fraction done.

    Returns:
        The largest error over the sensors, and the finer readings.
    """
    finer, fine_start = refine(system, start)
    fine = readings(finer, simulate(finer, fine_start, times, progress=progress))
    scale = torch.maximum(fine.std(dim=1), least).clamp(min=1e-12)
    change = (fine - coarse).square().mean(dim=1).sqrt()
    return float((change / scale).max().nan_to_num(nan=torch.inf)), fine


def check_resolution(
    system: System,
    start: Tensor,
    times: Tensor,
    coarse: Tensor,
    readings: Readings,
    least: Tensor,
    limit: float,
    progress: Progress | None = None,
) -> Resolution:
    """Measure the doubling error; if it is too large, find the resolution that would do.

    Above about 1 % of a trace's std, a discovery from that trace names the simulator's numerical
    error as missing physics (design §4.2.8).

    Args:
        system: the simulator.
        start: ``(1, field, *grid)``.
        times: output times.
        coarse: readings of a simulation, ``(1, time, sensor)``.
        readings: (system, trajectory) → traces ``(batch, time, sensor)``.
        least: what the change of a trace is held against at least, ``(sensor,)``.
        limit: of the change.
        progress: called with the fraction done.
    """
    error, fine = doubling_error(system, start, times, readings, coarse, least, progress)
    if error <= limit:
        return Resolution(error, limit, 1)
    finer, fine_start = refine(system, start)
    next_error, _ = doubling_error(finer, fine_start, times, readings, fine, least, progress)
    return Resolution(error, limit, 2 if next_error <= limit else None)
