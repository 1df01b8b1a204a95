"""The analysis of a simulator that is known by snapshots alone: everything but refinement."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from dashred.config import Config, config_sha256
from dashred.pipeline import problem, training
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.run import provenance
from dashred.pipeline.run.checkpoints import Checkpoints
from dashred.pipeline.run.output_dir import clear_output, named_output
from dashred.pipeline.run.parent_run import open_parent
from dashred.pipeline.run.run_manifest import SNAPSHOTS, manifest_of, remove_checkpoints
from dashred.pipeline.run.run_tags import log_input, log_result
from dashred.pipeline.snapshots import black_box_findings, black_box_report, snapshot_runs
from dashred.pipeline.snapshots.black_box_analysis import analyse_runs


def analyse_snapshots(config: Config) -> Path:
    """Analyse one recording, top to bottom; returns the folder of the findings.

    Raises:
        InputError: the input is wrong; nothing is written then, though the folder may be made.
    """
    provenance.prepare_torch(config)
    posed = problem.build_problem(config)
    named = named_output(config)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()
    runs = snapshot_runs.read_runs(posed, seconds)
    posed = keep_identifiable_terms(posed, runs.some, float(posed.times[0]))

    began = manifest_of(config, posed.recording_sha256) | {SNAPSHOTS: runs.sha256}
    with open_parent(config, named, began) as (run, folder):
        output = named or run.artifact_dir
        clear_output(output)
        log_input(run, config, provenance.git_commit())

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
        log_result(run, config, findings, output)
        provenance.write_record(run, output, findings, figures, seconds, config_sha256(config))
        remove_checkpoints(folder, output)
    return output
