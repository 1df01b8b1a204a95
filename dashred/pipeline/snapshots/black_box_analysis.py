"""Analysis from snapshots: SHRED, assimilation, latent SINDy and a mismatch test."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from dashred.core.progress import stage
from dashred.core.tracking import RunTracker
from dashred.data.recording import Recording
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.inference.latent_sindy.operator_inference import SnapshotSteps
from dashred.models.assimilation import AssimilatedEncoder
from dashred.models.lag_windows import windows
from dashred.models.shred import reconstruct
from dashred.physics.terms.column_blocks import rms_of_columns
from dashred.pipeline.networks import assimilation, training
from dashred.pipeline.problem import Problem
from dashred.pipeline.snapshots import mismatch, snapshot_runs
from dashred.pipeline.snapshots.snapshot_runs import SnapshotRuns

# The longest learned step is this part of the fit window, because drift shows over long steps.
LONG_STEP_DIVISOR = 5


@dataclass(frozen=True)
class BlackBoxAnalysis:
    """Results of an analysis from snapshots.

    Attributes:
        runs: the snapshots.
        network: SHRED, trained on the snapshots.
        assimilated: SHRED and DA-SHRED on the recording.
        steps: steps of the simulator, learned from the increments of the snapshots.
        compared: comparison of the recording with the snapshots.
        fields: by method, ``(time, field, *grid)``, over as much of the record as available.
    """

    runs: SnapshotRuns
    network: training.TrainedNetwork
    assimilated: assimilation.AssimilationResult
    steps: SnapshotSteps
    compared: mismatch.Mismatch
    fields: dict[str, Tensor]


def analyse_runs(
    problem: Problem,
    runs: SnapshotRuns,
    network: training.TrainedNetwork,
    run: RunTracker,
    seconds: dict[str, float],
) -> BlackBoxAnalysis:
    """Assimilate, propose terms, and test for a mismatch."""
    with stage("learn the snapshots' steps", seconds) as report:
        steps = _learn_steps(problem, runs, network)
        worst = max(steps.errors.values())
        report(1.0, f"relative error of increments {worst:.1%} on unseen runs")
    latent = _latent_problem(problem, runs, steps)
    assimilated, encoder = assimilation.fit_transform(problem, latent, network, run, seconds)
    compared = mismatch.compare(problem, network, runs, steps, assimilated.shred)
    fields = _estimates(problem, runs, network, assimilated, encoder)
    return BlackBoxAnalysis(runs, network, assimilated, steps, compared, fields)


@torch.no_grad()
def _learn_steps(
    problem: Problem, runs: SnapshotRuns, network: training.TrainedNetwork
) -> SnapshotSteps:
    states, pod = runs.ensemble.states, network.shred.pod
    shortest = min(states.shape[1], len(problem.split.fit.times))
    wanted = {*problem.config.latent_sindy.steps, max(1, shortest // LONG_STEP_DIVISOR)}
    strides = sorted(n for n in wanted if n <= shortest // 2)
    return SnapshotSteps.fit(problem.system, problem.library, pod, states, runs.held_out, strides)


@torch.no_grad()
def _latent_problem(problem: Problem, runs: SnapshotRuns, steps: SnapshotSteps) -> LatentProblem:
    fit, settings = problem.split.fit, problem.config.latent_sindy
    dt = float(problem.times[1] - problem.times[0])
    return LatentProblem(
        system=problem.system,
        library=problem.library,
        scales=_term_scales(problem, runs, dt),
        operator=problem.operator(fit.select(problem.split.inputs)),
        times=problem.times[: len(fit.times)],
        windows=assimilation.sensor_data(problem).windows[: len(fit.times)],
        settings=replace(settings, steps=[n for n in settings.steps if n in steps.by_stride]),
        seed=problem.config.seed,
        steps=steps,
    )


def _term_scales(problem: Problem, runs: SnapshotRuns, dt: float) -> Tensor:
    """Return ``rms(Δu/Δt)/rms(θ_j)`` over the first segment, ``(term,)``."""
    first = runs.ensemble.states[0]
    rates = (first[1:] - first[:-1]).transpose(0, 1).flatten(1).square().mean(dim=1).sqrt() / dt
    begin = float(problem.times[0])
    sizes = rms_of_columns(problem.system, problem.library, first, begin)
    of_equation = [problem.system.fields.index(term.equation) for term in problem.library]
    return rates[of_equation] / sizes.clamp(min=1e-12)


def _estimates(
    problem: Problem,
    runs: SnapshotRuns,
    network: training.TrainedNetwork,
    assimilated: assimilation.AssimilationResult,
    encoder: AssimilatedEncoder,
) -> dict[str, Tensor]:
    """Return the field by method; this is the first use of held-out samples."""
    count = len(problem.split.fit.times)
    inputs = torch.from_numpy(full_record(problem, problem.split.inputs).values)
    late = windows(inputs, problem.config.shred.lags).float().contiguous()[count:]
    shred = network.shred
    fields = {
        "shred_plain": torch.cat([assimilated.shred, reconstruct(shred.encode, shred, late)]),
        "dashred": torch.cat([assimilated.dashred, reconstruct(encoder, encoder.shred, late)]),
    }
    nearest = snapshot_runs.nearest_run(problem, runs)
    return fields if nearest is None else {"nearest_snapshots": nearest} | fields


def full_record(problem: Problem, names: tuple[str, ...]) -> Recording:
    """Return the readings of sensors that are not test sensors over the full record."""
    split = problem.split
    columns = []
    for name in names:
        early = split.fit if name in split.fit.names else split.validation
        parts = (early.select([name]).values, split.heldout.select([name]).values)
        columns.append(np.concatenate(parts))
    sensors = {sensor.name: sensor for sensor in split.heldout.sensors}
    chosen = tuple(sensors[name] for name in names)
    return Recording(chosen, problem.times.numpy(), np.concatenate(columns, axis=1))
