"""Whether a recording is like the snapshots at all: the one question that needs no simulator."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.inference.latent_sindy.operator_inference import SnapshotSteps
from dashred.models.lag_windows import windows
from dashred.models.shred import reconstruct
from dashred.pipeline.problem import Problem
from dashred.pipeline.snapshots.snapshot_runs import SnapshotRuns
from dashred.pipeline.training import Learned

# A recording is unlike the snapshots if it is missed by more than any of the runs that were not
# learnt from, by so many standard deviations of the logarithm of theirs, which has a floor.
BEYOND, FLOOR = 3.0, 0.1


@dataclass(frozen=True)
class Missed:
    """How the recording is missed, and runs of the simulation that were not learnt from.

    Attributes:
        error: RMSE on the recording, in units of each sensor's std over the snapshots.
        usual: the same on each stretch that was not learnt from, ``(stretch,)``.
        sensors: ratio of the recording's error to the usual one, by sensor.
    """

    error: float
    usual: Tensor
    sensors: dict[str, float]

    @property
    def beyond(self) -> bool:
        """Whether no run of the simulation is missed so."""
        logs = self.usual.clamp(min=1e-300).log()
        spread = max(float(logs.std()) if len(logs) > 1 else 0.0, FLOOR)
        distance = (torch.tensor(self.error).log() - logs.mean()) / spread
        return bool(self.error > self.usual.max()) and float(distance) > BEYOND

    @property
    def p(self) -> float:
        """Share of runs that are missed as much, the recording counted as one of them."""
        return (1 + int((self.usual >= self.error).sum())) / (1 + len(self.usual))


@dataclass(frozen=True)
class Mismatch:
    """How a recording is missed by what has learnt the snapshots alone.

    Attributes:
        states: by SHRED, which reads the field from its sensors' histories.
        changes: by the steps learnt from the snapshots, from SHRED's field over some samples.
        samples: so many.
    """

    states: Missed
    changes: Missed
    samples: int

    @property
    def seen(self) -> bool:
        """Whether the recording is unlike the snapshots."""
        return self.states.beyond or self.changes.beyond


@torch.no_grad()
def compare(
    problem: Problem, learned: Learned, runs: SnapshotRuns, steps: SnapshotSteps, shred: Tensor
) -> Mismatch:
    """Hold what the recording is missed by against the same on runs that were not learnt from.

    The fit and the validation sensors are looked at, in the fit window.

    Args:
        problem: the recording.
        learned: SHRED.
        runs: the snapshots.
        steps: learnt from them.
        shred: the field as SHRED reads it from the recording, ``(time, field, *grid)``.
    """
    split = problem.split
    parts = [split.fit, split.validation] if split.validate else [split.fit]
    operators = [problem.operator(part) for part in parts]
    names = [name for part in parts for name in part.names]

    def read(states: Tensor) -> Tensor:
        return torch.cat([operator(states) for operator in operators], dim=-1)

    recorded = torch.cat([torch.from_numpy(part.values) for part in parts], dim=-1)
    truth = read(runs.ensemble.states[-runs.held_out :])
    generator = torch.Generator().manual_seed(problem.config.seed)
    noise = torch.randn(truth.shape, generator=generator, dtype=truth.dtype)
    noisy = truth + problem.noise_of(tuple(names)) * noise
    inputs = [names.index(name) for name in split.inputs]
    histories = windows(noisy[..., inputs], problem.config.shred.lags).float()
    network = learned.shred
    found = torch.stack([reconstruct(network.encode, network, h.contiguous()) for h in histories])
    unit = read(runs.ensemble.states).flatten(0, 1).std(dim=0).clamp(min=1e-300)

    def missed(error: Tensor, usual: Tensor) -> Missed:
        squared, known = (error / unit).square(), (usual / unit).square()
        ratios = squared.nanmean(dim=0) / known.mean(dim=(0, 1)).clamp(min=1e-300)
        by_sensor = dict(zip(names, ratios.sqrt().tolist(), strict=True))
        return Missed(float(squared.nanmean().sqrt()), known.mean(dim=(1, 2)).sqrt(), by_sensor)

    samples = max(steps.by_stride)

    def change(states: Tensor, seen: Float[Tensor, "*batch time sensor"]) -> Tensor:
        time = seen.dim() - 2
        begins = states.narrow(time, 0, states.shape[time] - samples)
        made = read(steps.moved(begins, samples)) - read(begins)
        return made - (seen[..., samples:, :] - seen[..., :-samples, :])

    return Mismatch(
        missed(read(shred) - recorded, read(found) - noisy),
        missed(change(shred, recorded), change(found, noisy)),
        samples,
    )
