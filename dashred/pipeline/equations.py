"""The analysis of a simulator that is given by its equations, from top to bottom."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from dashred.config import Config, config_sha256
from dashred.core.tracking import RunTracker
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline import assimilation, problem, simulation, surrogate, training, trajectories
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.discovery import discovery
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.outputs import report
from dashred.pipeline.problem import Problem
from dashred.pipeline.run import provenance
from dashred.pipeline.run.checkpoints import Checkpoints, Stages
from dashred.pipeline.run.output_dir import clear_output, named_output
from dashred.pipeline.run.parent_run import open_parent
from dashred.pipeline.run.run_manifest import manifest_of, remove_checkpoints
from dashred.pipeline.run.run_tags import log_input, log_result
from dashred.pipeline.simulation import Nominal
from dashred.pipeline.verification import verification as verify
from dashred.pipeline.verification.structure import check_structure


@dataclass(frozen=True)
class Simulated:
    """A problem and the runs of its simulator, from which SHRED learns.

    Attributes:
        problem: with the terms that the sensors can identify.
        nominal: the simulator's run from its nominal start.
        resolution: the numerical error of that run.
        ensemble: of randomised runs; None where the simulator is not resolved.
    """

    problem: Problem
    nominal: Nominal
    resolution: Resolution
    ensemble: Ensemble | None


def simulate(posed: Problem, seconds: dict[str, float]) -> Simulated:
    """Run the simulator: from its nominal start, at doubled resolution, and as an ensemble.

    Raises:
        InputError: the input is wrong.
    """
    nominal = simulation.simulate_nominal(posed, seconds)
    posed = keep_identifiable_terms(posed, nominal.states, posed.times)
    check_structure(posed.system, posed.times, nominal.states)
    resolution = simulation.check(posed, nominal, seconds)
    ensemble = None
    if resolution.resolved:
        ensemble = simulation.simulate_ensemble(posed, nominal, seconds)
    return Simulated(posed, nominal, resolution, ensemble)


def discover(
    simulated: Simulated,
    ensemble: Ensemble,
    run: RunTracker,
    kept: Stages,
    seconds: dict[str, float],
) -> Analysis:
    """Train SHRED, assimilate, discover the law, and train SHRED on the corrected simulator."""
    posed, nominal = simulated.problem, simulated.nominal
    learned = kept.stage(
        "shred", lambda: training.train_shred(posed, ensemble, run, seconds, "SHRED")
    )
    found = kept.stage(
        "assimilate", lambda: assimilation.assimilate(posed, nominal, learned.shred, run, seconds)
    )
    discovered = kept.stage(
        "discover",
        lambda: discovery.discover(
            posed, nominal, simulated.resolution, ensemble, learned, found, run, seconds
        ),
    )
    free = trajectories.run_free(posed, nominal, discovered, seconds)
    relearned, (corrected_shred, *others) = kept.stage(
        "corrected_shred",
        lambda: surrogate.retrain(posed, nominal, discovered.best, free, learned, run, seconds),
    )
    return Analysis(
        nominal, learned, found, discovered, free, relearned, corrected_shred, tuple(others)
    )


def analyse_equations(config: Config) -> Path:
    """Analyse one recording; return the folder of the findings.

    Raises:
        InputError: the input is wrong. Nothing is written then, though the folder may be made.
    """
    provenance.prepare_torch(config)
    posed = problem.build_problem(config)
    named = named_output(config)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()
    simulated = simulate(posed, seconds)
    posed = simulated.problem

    # All errors of the input have been raised by now: only from here on is anything written.
    began = manifest_of(config, posed.recording_sha256)
    with open_parent(config, named, began) as (run, folder):
        output = named or run.artifact_dir
        clear_output(output)
        log_input(run, config, provenance.git_commit())
        kept = Checkpoints(folder, seconds)

        if simulated.ensemble is None:
            findings = verify.unresolved_findings(posed, simulated.resolution)
            verify.freeze_findings(output, findings, [])
            figures = report.report_unresolved(findings, output)
        else:
            analysis = discover(simulated, simulated.ensemble, run, kept, seconds)
            if config.tracking.model:
                learned = analysis.relearned
                kept.stage("model", lambda: surrogate.log_model(posed, learned, run, seconds))
            findings = verify.verify(posed, analysis)
            verify.write_findings(posed, analysis, findings, output)
            figures = report.report(posed, analysis, findings, output, seconds)

        seconds["in all"] = time.perf_counter() - clock + kept.earlier
        log_result(run, config, findings, output)
        provenance.finish(run, output, findings, figures, seconds, config_sha256(config))
        remove_checkpoints(folder, output)
    return output
