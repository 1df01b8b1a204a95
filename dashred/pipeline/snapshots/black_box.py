"""The analysis with snapshots in place of a simulator, without discovery of a law."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from dashred.config import Config, config_sha256
from dashred.core.tracking import RunTracker
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.networks import training
from dashred.pipeline.problem import Problem
from dashred.pipeline.run import provenance
from dashred.pipeline.run.checkpoints import Checkpoints, Stages
from dashred.pipeline.run.output_dir import clear_output, named_output
from dashred.pipeline.run.parent_run import open_parent
from dashred.pipeline.run.run_manifest import SNAPSHOTS, manifest_of, remove_checkpoints
from dashred.pipeline.run.run_tags import log_input, log_result
from dashred.pipeline.simulation.state_samples import StateSamples
from dashred.pipeline.snapshots import black_box_findings, black_box_report, snapshot_runs
from dashred.pipeline.snapshots.black_box_analysis import BlackBoxAnalysis, analyse_runs
from dashred.pipeline.snapshots.snapshot_runs import SnapshotRuns


def read_snapshots(problem: Problem, seconds: dict[str, float]) -> tuple[Problem, SnapshotRuns]:
    """Read the snapshots and keep the terms that the sensors can identify.

    Raises:
        InputError: the input is wrong.
    """
    runs = snapshot_runs.read_runs(problem, seconds)
    states = runs.sample_states
    samples = StateSamples(problem.system, states, problem.times[:1].expand(len(states)))
    return keep_identifiable_terms(problem, samples), runs


def discover(
    problem: Problem,
    runs: SnapshotRuns,
    run: RunTracker,
    checkpoints: Stages,
    seconds: dict[str, float],
) -> BlackBoxAnalysis:
    """Train SHRED, assimilate, propose terms, and test for a mismatch."""
    counted = replace(problem, config=runs.configured(problem.config))
    network = checkpoints.stage(
        "shred", lambda: training.train_shred(counted, runs.ensemble, run, seconds, "SHRED")
    )
    return analyse_runs(counted, runs, network, run, seconds)


def analyse_snapshots(config: Config) -> Path:
    """Analyse one recording; return the folder of the findings.

    Raises:
        InputError: the input is wrong; the output folder may have been created, but is empty.
    """
    provenance.prepare_torch(config)
    problem = build_problem(config)
    named = named_output(config)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()
    problem, runs = read_snapshots(problem, seconds)

    manifest = manifest_of(config, problem.recording_sha256) | {SNAPSHOTS: runs.sha256}
    with open_parent(config, named, manifest) as (run, folder):
        output = named or run.artifact_dir
        clear_output(output)
        log_input(run, config, provenance.git_commit())

        checkpoints = Checkpoints(folder, seconds, problem.budget)
        analysis = discover(problem, runs, run, checkpoints, seconds)
        findings = black_box_findings.verify(problem, analysis)
        black_box_findings.write(problem, analysis, findings, output)
        figures = black_box_report.report(problem, analysis, findings, output, seconds)

        seconds["in all"] = time.perf_counter() - clock + checkpoints.earlier
        log_result(run, config, findings, output)
        provenance.finish(run, output, findings, figures, seconds, config_sha256(config))
        remove_checkpoints(folder, output)
    return output
