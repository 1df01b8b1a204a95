"""The analysis with snapshots in place of a simulator, without discovery of a law."""

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
    """Analyse one recording; return the folder of the findings.

    Raises:
        InputError: the input is wrong; the output folder may have been created, but is empty.
    """
    provenance.prepare_torch(config)
    posed = problem.build_problem(config)
    named = named_output(config)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()
    runs = snapshot_runs.read_runs(posed, seconds)
    posed = keep_identifiable_terms(posed, runs.sample_states, float(posed.times[0]))

    manifest = manifest_of(config, posed.recording_sha256) | {SNAPSHOTS: runs.sha256}
    with open_parent(config, named, manifest) as (run, folder):
        output = named or run.artifact_dir
        clear_output(output)
        log_input(run, config, provenance.git_commit())

        counted = replace(posed, config=runs.configured(config))
        checkpoints = Checkpoints(folder, seconds)
        learned = checkpoints.stage(
            "shred", lambda: training.train_shred(counted, runs.ensemble, run, seconds, "SHRED")
        )
        analysis = analyse_runs(counted, runs, learned, run, seconds)
        findings = black_box_findings.verify(posed, analysis)
        black_box_findings.write(posed, analysis, findings, output)
        figures = black_box_report.report(posed, analysis, findings, output, seconds)

        seconds["in all"] = time.perf_counter() - clock + checkpoints.earlier
        log_result(run, config, findings, output)
        provenance.write_record(run, output, findings, figures, seconds, config_sha256(config))
        remove_checkpoints(folder, output)
    return output
