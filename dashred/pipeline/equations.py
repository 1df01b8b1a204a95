"""Analysis of a recording with a simulator that is given by equations: all stages in order."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dashred.config import Config, config_sha256
from dashred.core.budget import OutOfTimeError, duration
from dashred.core.errors import InputError
from dashred.core.tracking import RunTracker
from dashred.inference.forward.first_compilation import compile_integrators
from dashred.inference.hypotheses.result import Discovery
from dashred.inference.segments.findings.error_growth import is_chaotic
from dashred.inference.segments.findings.segment_laws import law_from_segments, states_by_sample
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.physics.external.failure import hint_of_failure
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline import assimilation, surrogate, training, trajectories
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.build_problem import build_problem
from dashred.pipeline.discovery import discovery
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.discovery.inputs import DiscoveryInputs
from dashred.pipeline.discovery.segments.relinearisation import with_fitted_readings
from dashred.pipeline.discovery.segments.segment_stage import (
    discover_in_segments,
    has_sensor_errors,
    search_in_segments,
)
from dashred.pipeline.outputs import report
from dashred.pipeline.problem import Problem
from dashred.pipeline.run import provenance
from dashred.pipeline.run.checkpoints import Checkpoints, Stages
from dashred.pipeline.run.output_dir import clear_output, named_output
from dashred.pipeline.run.parent_run import open_parent
from dashred.pipeline.run.run_manifest import manifest_of, remove_checkpoints
from dashred.pipeline.run.run_tags import log_input, log_result
from dashred.pipeline.simulation.ensembles import (
    ensemble_of_states,
    simulate_corrected_ensemble,
    simulate_ensemble,
    simulate_nudged_ensemble,
)
from dashred.pipeline.simulation.longer_step import with_longer_step
from dashred.pipeline.simulation.nominal_run import (
    NominalRun,
    can_be_corrected,
    corrected_towards_readings,
    simulate_nominal,
)
from dashred.pipeline.simulation.program_cost import follows_segments
from dashred.pipeline.simulation.resolution_check import check_corrected, check_discretisation
from dashred.pipeline.simulation.state_samples import state_samples
from dashred.pipeline.verification import verification as verify
from dashred.pipeline.verification.structure import check_structure

# The MLflow model is logged if more than this is left of the budget.
LOGGING_SECONDS = 15.0


@dataclass(frozen=True)
class SimulationRuns:
    """A problem and the runs of its simulator.

    Attributes:
        problem: problem, with the identifiable terms of the library.
        nominal: run from the nominal start.
        resolution: numerical error of that run.
        ensemble: randomised runs for training; None if the simulator is not resolved.
        segments: laws of a system without axes, found over segments; None for other systems.
    """

    problem: Problem
    nominal: NominalRun
    resolution: Resolution
    ensemble: Ensemble | None
    segments: SegmentSearch | None = None


def simulate(problem: Problem, seconds: dict[str, float]) -> SimulationRuns:
    """Run the simulator from its nominal start, at doubled resolution, and as an ensemble.

    Raises:
        InputError: the simulation blows up, the library has indistinguishable terms, or there is
            no time for the simulations.
    """
    try:
        return _simulate(problem, seconds)
    except OutOfTimeError:
        raise InputError(
            f"the simulations take longer than their part of the budget of "
            f"{problem.budget.seconds:g} s: {duration(problem.budget.spent, problem.budget.cpu)} "
            "since the start",
            where=problem.config.where("budget"),
            hint=hint_of_failure(
                problem.system.program,
                "give more time, budget=SECONDS, a coarser grid, or fewer simulation.members; "
                "other work on the machine takes time, too",
            ),
        ) from None


def _simulate(problem: Problem, seconds: dict[str, float]) -> SimulationRuns:
    nominal = simulate_nominal(problem, seconds)
    problem = keep_identifiable_terms(problem, state_samples(problem, nominal))
    check_structure(problem.system, problem.times, nominal.references[0])
    resolution = check_discretisation(problem, nominal, seconds)
    if resolution.enough == 2 and not problem.system.axes:
        # A grid is the user's, and costs more. A shorter step of an ODE system costs little.
        dt = problem.system.dt / 2
        reason = f"time step: {dt:.6g}, half of the stated one, whose error is visible"
        problem = problem.with_step(dt, reason)
        nominal = simulate_nominal(problem, seconds)
        resolution = check_discretisation(problem, nominal, seconds)
    if resolution.enough is None and can_be_corrected(problem, nominal):
        along = corrected_towards_readings(problem, nominal, seconds)
        locally = check_discretisation(problem, along, seconds)
        if locally.resolved:
            nominal, resolution = along, locally
    if not resolution.resolved:
        return SimulationRuns(problem, nominal, resolution, None)
    problem = with_longer_step(problem, nominal)
    problem, segments = search_in_segments(problem, nominal, seconds)
    if problem.hidden is not None:
        nominal = simulate_nominal(problem, seconds)
    ensemble = _training_ensemble(problem, nominal, segments, seconds)
    return SimulationRuns(problem, nominal, resolution, ensemble, segments)


def _training_ensemble(
    problem: Problem,
    nominal: NominalRun,
    segments: SegmentSearch | None,
    seconds: dict[str, float],
) -> Ensemble:
    """Return the runs on which SHRED is trained.

    If there are too few of the simulator, in time and within bounds, the corrected simulator is
    run instead where its law is known already; without time for that, the states of the law serve.
    """
    try:
        return simulate_ensemble(problem, nominal, seconds)
    except (InputError, OutOfTimeError) as error:
        if segments is not None:
            if isinstance(error, OutOfTimeError):
                problem.budget.leave_out("training SHRED on the simulator without the law")
            law = law_from_segments(segments, segments.best)
            states = states_by_sample(segments, segments.best)
            with suppress(OutOfTimeError):
                if not follows_segments(problem):
                    return simulate_corrected_ensemble(problem, law, states, seconds)
            problem.budget.leave_out("training SHRED on any simulation")
            return ensemble_of_states(problem, states)
        if nominal.restarted and isinstance(error, InputError):
            return simulate_nudged_ensemble(problem, nominal, seconds)
        raise


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
    """Train SHRED, assimilate, discover the law, and train SHRED on the corrected simulator.

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
        "assimilate", lambda: assimilation.assimilate(problem, nominal, network.shred, run, seconds)
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
    return Analysis(
        nominal,
        network,
        assimilated,
        discovered,
        runs,
        corrected_network,
        corrected_shred,
        tuple(others),
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
    # The first run of an installation compiles for many seconds. The budget begins after that, so
    # that the first run finds what later ones find.
    compile_integrators(config.system)
    problem = build_problem(config)
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
            findings = verify.unresolved_findings(problem, analysis)
            verify.freeze_findings(output, findings, [])
            figures = report.report_unresolved(findings, output)
        else:
            problem = with_fitted_readings(problem, analysis.discovery.best)
            findings = verify.verify(problem, analysis)
            verify.write_findings(problem, analysis, findings, output)
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
