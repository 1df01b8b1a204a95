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
from dashred.physics.library import evaluate_terms
from dashred.pipeline import assimilation, training
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
        learned: SHRED on them.
        found: SHRED and DA-SHRED on the recording.
        steps: steps of the simulator, learned from the increments of the snapshots.
        compared: comparison of the recording with the snapshots.
        fields: by method, ``(time, field, *grid)``, over as much of the record as available.
    """

    runs: SnapshotRuns
    learned: training.Learned
    found: assimilation.Assimilated
    steps: SnapshotSteps
    compared: mismatch.Mismatch
    fields: dict[str, Tensor]


def analyse_runs(
    posed: Problem,
    runs: SnapshotRuns,
    learned: training.Learned,
    run: RunTracker,
    seconds: dict[str, float],
) -> BlackBoxAnalysis:
    """Assimilate, propose terms, and test for a mismatch."""
    with stage("learn the snapshots' steps", seconds) as report:
        steps = _learn_steps(posed, runs, learned)
        worst = max(steps.errors.values())
        report(1.0, f"relative error of increments {worst:.1%} on unseen runs")
    latent = _latent_problem(posed, runs, steps)
    found, encoder = assimilation.fit_transform(posed, latent, learned.shred, run, seconds)
    compared = mismatch.compare(posed, learned, runs, steps, found.shred)
    fields = _estimates(posed, runs, learned, found, encoder)
    return BlackBoxAnalysis(runs, learned, found, steps, compared, fields)


@torch.no_grad()
def _learn_steps(posed: Problem, runs: SnapshotRuns, learned: training.Learned) -> SnapshotSteps:
    states, pod = runs.ensemble.states, learned.shred.pod
    shortest = min(states.shape[1], len(posed.split.fit.times))
    wanted = {*posed.config.latent_sindy.steps, max(1, shortest // LONG_STEP_DIVISOR)}
    strides = sorted(n for n in wanted if n <= shortest // 2)
    return SnapshotSteps.fit(posed.system, posed.library, pod, states, runs.held_out, strides)


@torch.no_grad()
def _latent_problem(posed: Problem, runs: SnapshotRuns, steps: SnapshotSteps) -> LatentProblem:
    fit, settings = posed.split.fit, posed.config.latent_sindy
    dt = float(posed.times[1] - posed.times[0])
    return LatentProblem(
        system=posed.system,
        library=posed.library,
        scales=_term_scales(posed, runs, dt),
        operator=posed.operator(fit.select(posed.split.inputs)),
        times=posed.times[: len(fit.times)],
        windows=assimilation.sensor_data(posed).windows[: len(fit.times)],
        settings=replace(settings, steps=[n for n in settings.steps if n in steps.by_stride]),
        seed=posed.config.seed,
        steps=steps,
    )


def _term_scales(posed: Problem, runs: SnapshotRuns, dt: float) -> Tensor:
    """Return ``rms(Δu/Δt)/rms(θ_j)`` over the first segment, ``(term,)``."""
    first = runs.ensemble.states[0]
    rates = (first[1:] - first[:-1]).transpose(0, 1).flatten(1).square().mean(dim=1).sqrt() / dt
    columns = evaluate_terms(posed.system, posed.library, first, float(posed.times[0]))
    sizes = columns.flatten(1).square().mean(dim=1).sqrt()
    of_equation = [posed.system.fields.index(term.equation) for term in posed.library]
    return rates[of_equation] / sizes.clamp(min=1e-12)


def _estimates(
    posed: Problem,
    runs: SnapshotRuns,
    learned: training.Learned,
    found: assimilation.Assimilated,
    encoder: AssimilatedEncoder,
) -> dict[str, Tensor]:
    """Return the field by method; this is the first use of held-out samples."""
    count = len(posed.split.fit.times)
    inputs = torch.from_numpy(full_record(posed, posed.split.inputs).values)
    late = windows(inputs, posed.config.shred.lags).float().contiguous()[count:]
    shred = learned.shred
    fields = {
        "shred_plain": torch.cat([found.shred, reconstruct(shred.encode, shred, late)]),
        "dashred": torch.cat([found.dashred, reconstruct(encoder, encoder.shred, late)]),
    }
    nearest = snapshot_runs.nearest_run(posed, runs)
    return fields if nearest is None else {"nearest_snapshots": nearest} | fields


def full_record(posed: Problem, names: tuple[str, ...]) -> Recording:
    """Return the readings of sensors that are not test sensors over the full record."""
    split = posed.split
    columns = []
    for name in names:
        early = split.fit if name in split.fit.names else split.validation
        parts = (early.select([name]).values, split.heldout.select([name]).values)
        columns.append(np.concatenate(parts))
    sensors = {sensor.name: sensor for sensor in split.heldout.sensors}
    chosen = tuple(sensors[name] for name in names)
    return Recording(chosen, posed.times.numpy(), np.concatenate(columns, axis=1))
