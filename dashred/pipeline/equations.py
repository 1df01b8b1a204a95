"""Analysis of a recording with a simulator that is given by equations: all stages in order."""

from __future__ import annotations

import time
from pathlib import Path

from torch import Tensor

from dashred.config import Config, config_sha256
from dashred.core.tracking import RunTracker
from dashred.inference.forward.first_compilation import compile_integrators
from dashred.inference.hypotheses.result import Discovery
from dashred.inference.initial_state.serial_analysis import compile_analysis
from dashred.inference.segments.findings.error_growth import is_chaotic
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline import surrogate, trajectories
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.discovery import discovery
from dashred.pipeline.discovery.inputs import DiscoveryInputs
from dashred.pipeline.discovery.segments.relinearisation import with_fitted_readings
from dashred.pipeline.discovery.segments.segment_stage import (
    discover_in_segments,
    has_sensor_errors,
)
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.networks import assimilation, training
from dashred.pipeline.observer import observe_episodes
from dashred.pipeline.outputs import report
from dashred.pipeline.problem import Problem
from dashred.pipeline.run import provenance
from dashred.pipeline.run.analysis_cluster import analysis_cluster
from dashred.pipeline.run.checkpoints import Checkpoints, Stages
from dashred.pipeline.run.output_dir import clear_output, named_output
from dashred.pipeline.run.parent_run import open_parent
from dashred.pipeline.run.run_manifest import manifest_of, remove_checkpoints
from dashred.pipeline.run.run_tags import log_input, log_result
from dashred.pipeline.simulation.program_cost import follows_segments
from dashred.pipeline.simulation.resolution_check import check_corrected
from dashred.pipeline.simulation_runs import SimulationRuns, simulate
from dashred.pipeline.verification import findings_files
from dashred.pipeline.verification.verification import unresolved_findings, verify

# The MLflow model is logged if more than this is left of the budget.
LOGGING_SECONDS = 15.0


def discover(
    simulated: SimulationRuns,
    run: RunTracker,
    checkpoints: Stages,
    seconds: dict[str, float],
) -> Analysis | Resolution:
    """Return the results of all stages; or the numerical error, if it forbids a verdict.

    If the uncorrected simulation is resolved in its first part only, the corrected one is checked.

    Args:
        simulated: problem and runs of the simulator.
        run: tracker of the parent run.
        checkpoints: stores the result of each stage.
        seconds: run time by stage, updated.
    """
    problem, resolution = simulated.problem, simulated.resolution
    if simulated.ensemble is None:
        return resolution
    analysis = _discover(simulated, simulated.ensemble, run, checkpoints, seconds)
    if not resolution.is_early:
        return analysis
    states = analysis.trajectories.states["corrected"][: len(problem.split.fit.times)]
    corrected = check_corrected(problem, analysis.discovery.best, states)
    return analysis if corrected.resolved else corrected


def _discover(
    simulated: SimulationRuns,
    ensemble: Ensemble,
    run: RunTracker,
    checkpoints: Stages,
    seconds: dict[str, float],
) -> Analysis:
    """Train SHRED, assimilate, discover the law, retrain SHRED, and observe the recording.

    Args:
        simulated: problem and runs of the simulator.
        ensemble: randomised runs for training.
        run: tracker of the parent run.
        checkpoints: stores the result of each stage.
        seconds: run time by stage, updated.
    """
    problem, nominal = simulated.problem, simulated.nominal
    network = checkpoints.stage(
        "shred", lambda: training.train_shred(problem, ensemble, run, seconds, "SHRED")
    )
    assimilated = checkpoints.stage(
        "assimilate", lambda: assimilation.assimilate(problem, nominal, network, run, seconds)
    )
    discovered = checkpoints.stage(
        "discover",
        lambda: _discover_law(simulated, ensemble, network, assimilated, run, seconds),
    )
    problem = with_fitted_readings(problem, discovered.best)
    runs = trajectories.simulate_trajectories(problem, nominal, discovered, seconds)
    corrected_network, (corrected_shred, *others) = checkpoints.stage(
        "corrected_shred",
        lambda: problem.budget.attempt(
            "corrected SHRED",
            lambda: surrogate.retrain(
                problem, nominal, discovered.best, runs, network, run, seconds
            ),
            (network, [assimilated.shred, *(shred for shred, _ in assimilated.others)]),
        ),
    )
    nothing: list[tuple[Tensor, Tensor]] = []
    observed = checkpoints.stage(
        "observer",
        lambda: problem.budget.attempt(
            "observer",
            lambda: observe_episodes(problem, nominal, discovered.best, runs, seconds),
            nothing,
        ),
    )
    return Analysis(
        nominal,
        network,
        assimilated,
        discovered,
        runs,
        corrected_network,
        corrected_shred,
        tuple(others),
        observed[0] if observed else None,
        tuple(observed[1:]),
    )


def _discover_law(
    simulated: SimulationRuns,
    ensemble: Ensemble,
    network: training.TrainedNetwork,
    assimilated: assimilation.AssimilationResult,
    run: RunTracker,
    seconds: dict[str, float],
) -> Discovery:
    """Discover the law along one trajectory, or over segments where none can be followed."""
    problem, nominal, segments = simulated.problem, simulated.nominal, simulated.segments
    if segments is not None and (
        nominal.restarted
        or is_chaotic(segments)
        or has_sensor_errors(segments)
        or follows_segments(problem)
    ):
        with run.child("discover") as child:
            return discover_in_segments(problem, segments, child, seconds)
    given = DiscoveryInputs(
        problem, nominal, simulated.resolution, ensemble, network, assimilated, segments
    )
    return discovery.discover(given, run, seconds)


def analyse_equations(config: Config) -> Path:
    """Analyse one recording and return the output folder.

    Raises:
        InputError: the input is wrong; the output folder may have been created, but is empty.
    """
    provenance.prepare_torch(config)
    with analysis_cluster(config):
        return _analyse(config)


def _analyse(config: Config) -> Path:
    # The first run of an installation compiles for many seconds. The budget begins after that, so
    # that the first run finds what later ones find.
    compile_integrators(config.system)
    compile_analysis()
    problem = build_problem(config)
    with problem.scratch.removed_at_the_end():
        return _analyse_problem(problem)


def _analyse_problem(problem: Problem) -> Path:
    config = problem.config
    named = named_output(config)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()
    simulated = simulate(problem, seconds)
    problem = simulated.problem

    # All input errors have been raised by now, so files may be written.
    manifest = manifest_of(config, problem.recording_sha256)
    with open_parent(config, named, manifest) as (run, folder):
        output = named or run.artifact_dir
        clear_output(output)
        log_input(run, config, provenance.git_commit())
        checkpoints = Checkpoints(folder, seconds, problem.budget)

        analysis = discover(simulated, run, checkpoints, seconds)
        if isinstance(analysis, Resolution):
            findings = unresolved_findings(problem, analysis)
            findings_files.freeze_findings(output, findings, [])
            figures = report.report_unresolved(findings, output)
        else:
            problem = with_fitted_readings(problem, analysis.discovery.best)
            findings = verify(problem, analysis)
            findings_files.write_findings(problem, analysis, findings, output)
            figures = report.report(problem, analysis, findings, output, seconds)
            # Not in the list of what was left out: it changes nothing in the findings.
            if config.tracking.model and problem.budget.left > LOGGING_SECONDS:
                network = analysis.corrected_network
                checkpoints.stage(
                    "model", lambda: surrogate.log_model(problem, network, run, seconds)
                )

        seconds["in all"] = time.perf_counter() - clock + checkpoints.earlier
        log_result(run, config, findings, output)
        provenance.finish(run, output, findings, figures, seconds, config_sha256(config))
        remove_checkpoints(folder, output)
    return output
