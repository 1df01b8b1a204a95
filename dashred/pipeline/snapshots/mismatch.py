"""Test whether a recording is consistent with the snapshots, without a simulator."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.inference.latent_sindy.operator_inference import SnapshotSteps
from dashred.models.lag_windows import windows
from dashred.models.shred import reconstruct
from dashred.physics.runs.stored_states import each_state, part
from dashred.pipeline.networks.training import TrainedNetwork
from dashred.pipeline.problem import Problem
from dashred.pipeline.snapshots.snapshot_runs import SnapshotRuns

# A recording is inconsistent if its error exceeds that of all validation runs, and the mean of the
# logarithm of theirs by this many standard deviations, which are at least FLOOR.
THRESHOLD, FLOOR = 3.0, 0.1


@dataclass(frozen=True)
class ErrorComparison:
    """Error of the recording, compared with validation runs of the simulation.

    Attributes:
        error: RMSE on the recording, in units of each sensor's std over the snapshots.
        usual: the same on each validation segment, ``(segment,)``.
        sensors: error of the recording over the usual error, by sensor.
    """

    error: float
    usual: Tensor
    sensors: dict[str, float]

    @property
    def beyond(self) -> bool:
        """Whether the error is larger than that of any validation run."""
        logs = self.usual.clamp(min=1e-300).log()
        spread = max(float(logs.std()) if len(logs) > 1 else 0.0, FLOOR)
        distance = (torch.tensor(self.error).log() - logs.mean()) / spread
        return bool(self.error > self.usual.max()) and float(distance) > THRESHOLD

    @property
    def p(self) -> float:
        """Share of runs with an error at least as large, counting the recording as a run."""
        return (1 + int((self.usual >= self.error).sum())) / (1 + len(self.usual))


@dataclass(frozen=True)
class Mismatch:
    """Comparison of a recording with models learned from the snapshots.

    Attributes:
        states: errors of SHRED, which reconstructs the field from sensor histories.
        changes: errors of the learned steps, from the field of SHRED over `samples` samples.
        samples: number of samples of a step.
    """

    states: ErrorComparison
    changes: ErrorComparison
    samples: int

    @property
    def seen(self) -> bool:
        """Whether the recording is inconsistent with the snapshots."""
        return self.states.beyond or self.changes.beyond


@torch.no_grad()
def compare(
    problem: Problem,
    network: TrainedNetwork,
    runs: SnapshotRuns,
    steps: SnapshotSteps,
    shred: Tensor,
) -> Mismatch:
    """Compare the errors on the recording with those on validation runs.

    Uses the fit and the validation sensors in the fit window.

    Args:
        problem: the recording.
        network: SHRED, trained on the snapshots.
        runs: the snapshots.
        steps: steps learned from them.
        shred: field of SHRED from the recording, ``(time, field, *grid)``.
    """
    split = problem.split
    recorded_parts = [split.fit, split.validation] if split.validate else [split.fit]
    operators = [problem.operator(own) for own in recorded_parts]
    names = [name for own in recorded_parts for name in own.names]

    def read(states: Tensor) -> Tensor:
        return torch.cat([operator(states) for operator in operators], dim=-1)

    recorded = torch.cat([torch.from_numpy(own.values) for own in recorded_parts], dim=-1)
    truth = each_state(read, part(runs.ensemble.states, slice(-runs.held_out, None)))
    generator = torch.Generator().manual_seed(problem.config.seed)
    noise = torch.randn(truth.shape, generator=generator, dtype=truth.dtype)
    noisy = truth + problem.noise_of(tuple(names)) * noise
    inputs = [names.index(name) for name in split.inputs]
    histories = windows(noisy[..., inputs], problem.config.shred.lags).float()
    shred_network = network.shred
    estimates = torch.stack(
        [reconstruct(shred_network.encode, shred_network, h.contiguous()) for h in histories]
    )
    unit = each_state(read, runs.ensemble.states).flatten(0, 1).std(dim=0).clamp(min=1e-300)

    def error_comparison(error: Tensor, usual: Tensor) -> ErrorComparison:
        squared, known = (error / unit).square(), (usual / unit).square()
        ratios = squared.nanmean(dim=0) / known.mean(dim=(0, 1)).clamp(min=1e-300)
        by_sensor = dict(zip(names, ratios.sqrt().tolist(), strict=True))
        return ErrorComparison(
            float(squared.nanmean().sqrt()), known.mean(dim=(1, 2)).sqrt(), by_sensor
        )

    samples = max(steps.by_stride)

    def change(states: Tensor, seen: Float[Tensor, "*batch time sensor"]) -> Tensor:
        time = seen.dim() - 2
        begins = states.narrow(time, 0, states.shape[time] - samples)
        made = read(steps.advance(begins, samples)) - read(begins)
        return made - (seen[..., samples:, :] - seen[..., :-samples, :])

    return Mismatch(
        error_comparison(read(shred) - recorded, read(estimates) - noisy),
        error_comparison(change(shred, recorded), change(estimates, noisy)),
        samples,
    )
