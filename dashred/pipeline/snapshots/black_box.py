"""The analysis of a simulator that is known by snapshots alone: everything but refinement."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dashred.config import Config, config_sha256
from dashred.core.mlflow.tracker import Tracker
from dashred.core.progress import stage
from dashred.data.recording import Recording
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.inference.latent_sindy.operator_inference import SnapshotSteps
from dashred.models.assimilation import AssimilatedEncoder
from dashred.models.lag_windows import windows
from dashred.models.shred import reconstruct
from dashred.physics.library import evaluate_terms
from dashred.pipeline import assimilation, problem, training
from dashred.pipeline.discovery.identifiable_terms import told_apart
from dashred.pipeline.problem import Problem
from dashred.pipeline.run import provenance
from dashred.pipeline.run.checkpoints import Checkpoints
from dashred.pipeline.run.output_dir import clear_output, named_output
from dashred.pipeline.run.parent_run import open_parent
from dashred.pipeline.run.run_manifest import SNAPSHOTS, began_with, end
from dashred.pipeline.run.run_tags import conclude, describe
from dashred.pipeline.snapshots import mismatch, snapshot_runs
from dashred.pipeline.snapshots.snapshot_runs import SnapshotRuns

# The longest step that is learnt is such a part of the fit window: drift shows over long ones.
LONG = 5


@dataclass(frozen=True)
class BlackBoxAnalysis:
    """What can be found out from snapshots.

    Attributes:
        runs: the snapshots.
        learned: SHRED on them.
        found: SHRED and DA-SHRED on the recording.
        steps: the simulator's steps, learnt from the snapshots' increments.
        compared: whether the recording is like the snapshots at all.
        fields: by method, ``(time, field, *grid)``, over the whole record where the method reaches
            so far.
    """

    runs: SnapshotRuns
    learned: training.Learned
    found: assimilation.Assimilated
    steps: SnapshotSteps
    compared: mismatch.Mismatch
    fields: dict[str, Tensor]


def analyse_snapshots(config: Config) -> Path:
    """Analyse one recording, top to bottom; returns the folder of the findings.

    Raises:
        InputError: the input is wrong; nothing is written then, though the folder may be made.
    """
    from dashred.pipeline.snapshots import black_box_findings, black_box_report

    provenance.prepare_torch(config)
    posed = problem.pose(config)
    named = named_output(config)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()
    runs = snapshot_runs.read_runs(posed, seconds)
    posed = told_apart(posed, runs.some, float(posed.times[0]))

    began = began_with(config, posed.recording_sha256) | {SNAPSHOTS: runs.sha256}
    with open_parent(config, named, began) as (run, folder):
        output = named or run.artifact_dir
        clear_output(output)
        describe(run, config, provenance.git_commit())

        counted = replace(posed, config=runs.configured(config))
        kept = Checkpoints(folder, seconds)
        learned = kept.stage(
            "shred", lambda: training.train_shred(counted, runs.ensemble, run, seconds, "SHRED")
        )
        analysis = analyse_runs(counted, runs, learned, run, seconds)
        findings = black_box_findings.verify(posed, analysis)
        black_box_findings.write(posed, analysis, findings, output)
        figures = black_box_report.report(posed, analysis, findings, output, seconds)

        seconds["in all"] = time.perf_counter() - clock + kept.earlier
        conclude(run, config, findings, output)
        provenance.finish(run, output, findings, figures, seconds, config_sha256(config))
        end(folder, output)
    return output


def analyse_runs(
    posed: Problem,
    runs: SnapshotRuns,
    learned: training.Learned,
    run: Tracker,
    seconds: dict[str, float],
) -> BlackBoxAnalysis:
    """Assimilate, propose terms, and tell whether anything is missing at all."""
    with stage("learn the snapshots' steps", seconds) as report:
        steps = _learn_steps(posed, runs, learned)
        worst = max(steps.errors.values())
        report(1.0, f"increments to {worst:.1%} on runs that it has not seen")
    latent = _latent_problem(posed, runs, steps)
    found, encoder = assimilation.fit_transform(posed, latent, learned.shred, run, seconds)
    compared = mismatch.compare(posed, learned, runs, steps, found.shred)
    fields = _estimates(posed, runs, learned, found, encoder)
    return BlackBoxAnalysis(runs, learned, found, steps, compared, fields)


@torch.no_grad()
def _learn_steps(posed: Problem, runs: SnapshotRuns, learned: training.Learned) -> SnapshotSteps:
    states, pod = runs.ensemble.states, learned.shred.pod
    shortest = min(states.shape[1], len(posed.split.fit.times))
    wanted = {*posed.config.latent_sindy.steps, max(1, shortest // LONG)}
    strides = sorted(n for n in wanted if n <= shortest // 2)
    return SnapshotSteps.learn(posed.system, posed.library, pod, states, runs.held_out, strides)


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
    """Return ``rms(Δu/Δt)/rms(θ_j)`` over the first stretch, ``(term,)``."""
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
    """Return the field by method; what was held out is read here for the first time."""
    count = len(posed.split.fit.times)
    seen = torch.from_numpy(whole(posed, posed.split.inputs).values)
    late = windows(seen, posed.config.shred.lags).float().contiguous()[count:]
    shred = learned.shred
    fields = {
        "shred_plain": torch.cat([found.shred, reconstruct(shred.encode, shred, late)]),
        "dashred": torch.cat([found.dashred, reconstruct(encoder, encoder.shred, late)]),
    }
    nearest = snapshot_runs.nearest_run(posed, runs)
    return fields if nearest is None else {"snapshots": nearest} | fields


def whole(posed: Problem, names: tuple[str, ...]) -> Recording:
    """Return some of the sensors that are no test sensors over the whole record."""
    split = posed.split
    columns = []
    for name in names:
        early = split.fit if name in split.fit.names else split.validation
        parts = (early.select([name]).values, split.heldout.select([name]).values)
        columns.append(np.concatenate(parts))
    sensors = {sensor.name: sensor for sensor in split.heldout.sensors}
    kept = tuple(sensors[name] for name in names)
    return Recording(kept, posed.times.numpy(), np.concatenate(columns, axis=1))
