"""Time the march and the columns of fields on a device beside the CPU of the same machine.

``python -m dashred.evaluation.benchmark.device_timings cuda`` prints the table of
docs/performance.md. Every figure is the shorter of two runs, after a short one that compiles.
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.config import load_config
from dashred.core.threads import use_threads
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import CPU, System
from dashred.physics.terms.library import build_library, resolve

CASES = [
    (name, points) for name in ("ks2d", "kolmogorov", "gray_scott") for points in (64, 128, 256)
]
TRAJECTORIES, DIRECTIONS, TERMS, STEPS, RUNS = 32, 200, 3, 16, 2
HEADER = f"{'system':<12}{'points':>8}{'columns':>9}" + "".join(
    f"{name:>12}" for name in ("march CPU", "device", "error", "columns CPU", "device", "error")
)


class Timed(NamedTuple):
    """A result and the seconds that it took."""

    values: Tensor
    seconds: float


def main(device: torch.device) -> None:
    """Print one line for every system and grid."""
    use_threads(os.cpu_count() or 1)
    torch.set_num_threads(1)
    print(f"CPU: {os.cpu_count()} cores, {platform.processor() or platform.machine()}")
    if device.type == "cuda":
        print(f"device: {torch.cuda.get_device_name(device)}")
    print(f"torch {torch.__version__}\n{HEADER}", flush=True)
    for name, points in CASES:
        words = [f"system.axes.{axis}.points={points}" for axis in "xy"]
        config = load_config([f"conf={name}", *words], entry="train")
        system = System(config.system, config.where)
        library = resolve(system, build_library(system, config.library))
        candidates = [Candidate(str(i), t.equation, (t,), 1.0) for i, t in enumerate(library)]
        start = _starts(system)
        weights = torch.zeros((TRAJECTORIES, len(library)), dtype=torch.float64)
        weights[:, 1 : 1 + TERMS] = 1e-3
        times = float(system.dt) * torch.tensor([0.0, 1.0, STEPS]).double()
        march, columns = [], []
        for each in (system, system.on(device)):
            simulator = CandidateSimulator(each, each.dt, candidates)
            march.append(_timed(partial(_march, simulator, start, weights), times))
            columns.append(_timed(partial(_columns, simulator, start, weights[:1]), times))
        count = DIRECTIONS + len(library)
        print(f"{name:<12}{points:>6}^2{count:>9}{_line(*march)}{_line(*columns)}", flush=True)
    if device.type == "cuda":
        memory = torch.cuda.max_memory_allocated(device) / 2**30
        print(f"largest memory on the device: {memory:.1f} GiB")


def _starts(system: System) -> Tensor:
    """Return smooth states near the nominal start, ``(trajectory, field, *grid)``."""
    generator = torch.Generator().manual_seed(0)
    start = nominal_start(system)
    noise = torch.randn((TRAJECTORIES + DIRECTIONS, *start.shape[1:]), generator=generator)
    modes = torch.fft.rfftn(noise.double(), dim=system.grid.dims)
    modes = modes * (sum(k**2 for k in system.product_grid.wavenumbers) < 8**2)
    smooth = torch.fft.irfftn(modes, s=system.grid.shape, dim=system.grid.dims)
    return start + 0.01 * smooth / smooth.std()


def _march(simulator: CandidateSimulator, start: Tensor, weights: Tensor, times: Tensor) -> Tensor:
    """Return the last states of the trajectories."""
    return simulator.run(start[:TRAJECTORIES], times, weights)[:, -1]


def _columns(
    simulator: CandidateSimulator, start: Tensor, weights: Tensor, times: Tensor
) -> Tensor:
    """Return the columns at some points, as sensors read them; the weights are the law's."""
    law = Forcing(simulator.terms, weights)
    sources = [(term,) for term in simulator.terms]
    compiled = weights if simulator.compiled else None
    base, directions = start[0], start[TRAJECTORIES:] - start[:1]
    samples = simulator.tangents(base, directions, times, law, sources, None, None, compiled)
    return torch.stack([columns[..., ::8, ::8].cpu() for _, columns in samples])


def _timed(run: Callable[[Tensor], Tensor], times: Tensor) -> Timed:
    run(times[:2])
    seconds = []
    for _ in range(RUNS):
        begin = time.perf_counter()
        values = run(times)
        seconds.append(time.perf_counter() - begin)
    return Timed(values, min(seconds))


def _line(ours: Timed, device: Timed) -> str:
    error = float((ours.values - device.values).norm() / ours.values.norm())
    return f"{ours.seconds:>12.3f}{device.seconds:>12.3f}{error:>12.1e}"


if __name__ == "__main__":
    main(torch.device(sys.argv[1]) if len(sys.argv) > 1 else CPU)
