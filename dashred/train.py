"""Find what physics a simulation leaves out: ``python -m dashred.train conf=rde``.

A twin experiment (``recording.twin=a``) is three processes: a recorder that knows the hidden
truth, this analysis, which is handed the recording alone, and a scorer that opens the seal when
the findings are frozen. What was cut short goes on with ``resume=RUN_ID``, or where the same
command is given again with the same ``output=DIR``.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from dashred.config import Config, config_sha256, load_config
from dashred.config.checks.placeholders import refuse_open_lines
from dashred.core.errors import InputError, run_entry
from dashred.core.mlflow.server import check_server


def main(argv: list[str]) -> int:
    """Run the analysis, or the twin experiment around it."""
    helping = {"--help", "-h"} & set(argv)
    if not helping and any(word.startswith("resume=") for word in argv):
        from dashred.pipeline.run.resume import resume

        return resume(argv)
    config = load_config(argv, entry="train")
    refuse_open_lines(config)
    check_server(config.tracking.root)
    if config.recording.twin is not None:
        from dashred.evaluation.twins.twin_experiment import run_twin

        return run_twin(config, argv)
    if config.recording.path is None:
        raise InputError(
            "there is nothing to analyse",
            where=config.where("recording"),
            hint="give recording.path=FILE, or recording.twin=NAME for a twin experiment",
        )
    if config.system.snapshots is not None:
        from dashred.pipeline.snapshots.black_box import analyse_snapshots

        analyse_snapshots(config)
    else:
        analyse(config)
    return 0


def analyse(config: Config) -> Path:
    """Analyse one recording, top to bottom; returns the folder of the findings.

    Raises:
        InputError: the input is wrong; nothing is written then, though the folder may be made.
    """
    from dashred.pipeline import (
        assimilation,
        problem,
        simulation,
        surrogate,
        training,
        trajectories,
    )
    from dashred.pipeline.analysis import Analysis
    from dashred.pipeline.discovery import discovery
    from dashred.pipeline.discovery.identifiable_terms import told_apart
    from dashred.pipeline.outputs import report
    from dashred.pipeline.run import provenance
    from dashred.pipeline.run.checkpoints import Checkpoints
    from dashred.pipeline.run.output_dir import clear_output, named_output
    from dashred.pipeline.run.parent_run import open_parent
    from dashred.pipeline.run.run_manifest import began_with, end
    from dashred.pipeline.run.run_tags import conclude, describe
    from dashred.pipeline.verification import verification as verify
    from dashred.pipeline.verification.structure import check_structure

    provenance.prepare_torch(config)
    posed = problem.pose(config)
    named = named_output(config)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()
    nominal = simulation.simulate_nominal(posed, seconds)
    posed = told_apart(posed, nominal.states, posed.times)
    check_structure(posed.system, posed.times, nominal.states)
    resolution = simulation.check(posed, nominal, seconds)
    ensemble = None
    if resolution.resolved:
        ensemble = simulation.simulate_ensemble(posed, nominal, seconds)

    # Whatever can be wrong with the input has been met by here: only now is anything written.
    began = began_with(config, posed.recording_sha256)
    with open_parent(config, named, began) as (run, folder):
        output = named or run.artifact_dir
        clear_output(output)
        describe(run, config, provenance.git_commit())
        kept = Checkpoints(folder, seconds)

        if ensemble is None:
            findings = verify.refuse_unresolved(posed, resolution)
            verify.freeze_findings(output, findings, [])
            figures = report.report_unresolved(findings, output)
        else:
            learned = kept.stage(
                "shred", lambda: training.train_shred(posed, ensemble, run, seconds, "SHRED")
            )
            found = kept.stage(
                "assimilate",
                lambda: assimilation.assimilate(posed, nominal, learned.shred, run, seconds),
            )
            discovered = kept.stage(
                "discover",
                lambda: discovery.discover(
                    posed, nominal, resolution, ensemble, learned, found, run, seconds
                ),
            )
            free = trajectories.run_free(posed, nominal, discovered, seconds)
            relearned, (corrected_shred, *others) = kept.stage(
                "corrected_shred",
                lambda: surrogate.retrain(
                    posed, nominal, discovered.best, free, learned, run, seconds
                ),
            )
            analysis = Analysis(
                nominal,
                learned,
                found,
                discovered,
                free,
                relearned,
                corrected_shred,
                tuple(others),
            )
            findings = verify.verify(posed, analysis)
            verify.write_findings(posed, analysis, findings, output)
            figures = report.report(posed, analysis, findings, output, seconds)

        seconds["in all"] = time.perf_counter() - clock + kept.earlier
        conclude(run, config, findings, output)
        provenance.finish(run, output, findings, figures, seconds, config_sha256(config))
        end(folder, output)
    return output


if __name__ == "__main__":
    sys.exit(run_entry(main))
