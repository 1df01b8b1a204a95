"""Check of the numerical resolution: the change of sensor traces at doubled resolution."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.physics.solvers.simulate import Progress, simulate
from dashred.physics.system import System

Readings = Callable[[System, Tensor], Tensor]
# A numerical error of this share of the noise causes no significant bias.
NOISE_SHARE = 0.1
# Factor by which the step is shorter if half of it is unstable at doubled resolution: the largest
# stable one of a fourth derivative is a sixteenth.
SHORTER_STEP = 8.0
# A simulation that grows by this factor is unstable.
UNSTABLE = 1e6
# Samples of a segment, and the largest number of segments that are simulated.
SEGMENT, MOST_SEGMENTS = 4, 8


@dataclass(frozen=True)
class Resolution:
    """Result of doubling the resolution in space and time.

    Attributes:
        error: largest rms change of a sensor trace, in units of the trace's std, or of
            :func:`minimum_scale` if that is larger.
        limit: allowed change.
        enough: refinement factor at which the change is below the limit; None if no tried
            factor suffices.
        is_early: whether only the first part of the simulation is resolved. Without the dissipation
            that it lacks, a simulation may create ever finer structures.
    """

    error: float
    limit: float
    enough: int | None
    is_early: bool = False

    @property
    def resolved(self) -> bool:
        """Whether the error is within the limit."""
        return self.error <= self.limit


def refine(system: System, start: Tensor) -> tuple[System, Tensor]:
    """Return the system at doubled resolution, and a start ``(1, field, *grid)`` on its grid."""
    finer = system.refined()
    return finer, system.grid.interpolate(start, finer.grid) if system.axes else start


def simulate_refined(
    system: System, start: Tensor, times: Tensor, progress: Progress | None = None
) -> tuple[System, Tensor]:
    """Return a system at doubled resolution, and its trajectory.

    Terms in explicit steps allow only shorter steps on a finer grid: half the step may be unstable.

    Args:
        system: the simulator.
        start: ``(1, field, *grid)``, interpolated to the finer grid.
        times: output times.
        progress: called with the fraction done.
    """
    finer, fine_start = refine(system, start)
    path = simulate(finer, fine_start, times, progress=progress)
    # Written with "not", because the values may be NaN.
    if system.axes and not path.abs().max() < UNSTABLE * fine_start.abs().max().clamp(min=1.0):
        finer = finer.with_step(finer.dt / SHORTER_STEP)
        path = simulate(finer, fine_start, times, progress=progress)
    return finer, path


def minimum_scale(
    traces: Float[Tensor, "time sensor"],
    noise: Float[Tensor, " sensor"],
    reads: Sequence[str],
    limit: float,
) -> Float[Tensor, " sensor"]:
    """Return the smallest scale for the change of a trace, for traces that are nearly constant.

    It is ``σ/(10·limit)``, for which the limit is a tenth of the noise, but at most the median std
    of the traces of the same quantity, in case the stated noise is too large.

    Args:
        traces: of a simulation.
        noise: σ of every sensor.
        reads: quantity of every sensor.
        limit: allowed change, as a share of a trace's std.
    """
    std = traces.std(dim=0)
    typical = {kind: std[[r == kind for r in reads]].quantile(0.5) for kind in set(reads)}
    return torch.minimum(
        NOISE_SHARE / limit * noise, torch.stack([typical[kind] for kind in reads])
    )


@torch.no_grad()
def accumulated_error(
    system: System,
    path: Tensor,
    times: Tensor,
    readings: Readings,
    least: Tensor,
    share: float = 1.0,
    samples: int = SEGMENT,
) -> float:
    """Return the sum of the doubling errors of short segments that cover the record.

    This would be the error over the record if the system did not amplify errors. In a chaotic
    system any difference grows into another trajectory, so the error over the record itself says
    nothing about the resolution.

    Args:
        system: the simulator.
        path: its states, ``(time, field, *grid)``; segments start from them.
        times: ``(time,)``.
        readings: (system, trajectory) → traces ``(batch, time, sensor)``.
        least: smallest scale for the change of a trace, ``(sensor,)``.
        share: first part of the record whose segments are simulated, as a share of it.
        samples: of a segment.

    Returns:
        The largest sum over the sensors and the whole record, in units of :class:`Resolution`.
    """
    segments = max(1, (len(times) - 1) // samples)
    stride = samples * -(-math.ceil(share * segments) // MOST_SEGMENTS)
    begins = range(0, max(1, round(share * (len(times) - samples))), stride)
    changes = []
    for first in begins:
        clock, start = times[first : first + samples + 1], path[first : first + 1]
        fine = readings(*simulate_refined(system, start, clock))
        coarse = readings(system, simulate(system, start, clock))
        changes.append((fine - coarse)[0, -1].square())
    traces = readings(system, path[None])[0, : begins[-1] + samples + 1]
    scale = torch.maximum(traces.std(dim=0), least).clamp(min=1e-12)
    each = torch.stack(changes).mean(dim=0).sqrt() / scale
    return float((segments * each).max().nan_to_num(nan=torch.inf))


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
        coarse: readings at the original resolution.
        least: smallest scale for the change of a trace, ``(sensor,)``.
        progress: called with the fraction done.

    Returns:
        The largest error over the sensors, and the finer readings.
    """
    fine = readings(*simulate_refined(system, start, times, progress))
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
    """Measure the doubling error; if it is too large, find a sufficient resolution.

    If the error exceeds about 1 % of a trace's std, a discovery may explain the numerical error as
    missing physics.

    Args:
        system: the simulator.
        start: ``(1, field, *grid)``.
        times: output times.
        coarse: readings of a simulation, ``(1, time, sensor)``.
        readings: (system, trajectory) → traces ``(batch, time, sensor)``.
        least: smallest scale for the change of a trace, ``(sensor,)``.
        limit: allowed error.
        progress: called with the fraction done.
    """
    error, fine = doubling_error(system, start, times, readings, coarse, least, progress)
    if error <= limit:
        return Resolution(error, limit, 1)
    finer, fine_start = refine(system, start)
    next_error, _ = doubling_error(finer, fine_start, times, readings, fine, least, progress)
    return Resolution(error, limit, 2 if next_error <= limit else None)
