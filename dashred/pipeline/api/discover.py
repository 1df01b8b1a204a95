"""Run all stages of an analysis on a recording in memory and return the result."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from dashred.config import Config
from dashred.core.budget import Budget
from dashred.core.findings.findings import canonical
from dashred.core.findings.schema import Findings
from dashred.core.progress import Silent, shown_on
from dashred.core.tracking import NullTracker
from dashred.data.episodes import Episodes
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline import equations, simulation_runs
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.api.result import Result
from dashred.pipeline.api.simulator import Simulator
from dashred.pipeline.discovery.segments.relinearisation import with_fitted_readings
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.outputs import report
from dashred.pipeline.outputs.figures import figures_of
from dashred.pipeline.problem import Problem
from dashred.pipeline.run.checkpoints import NoCheckpoints
from dashred.pipeline.run.output_dir import clear_output, named_output
from dashred.pipeline.run.provenance import write_record, write_summary
from dashred.pipeline.snapshots import black_box, black_box_findings, black_box_report
from dashred.pipeline.verification import findings_files, verification

Write = Callable[[Path], object]


def discover(config: Config, recorded: Episodes) -> Result:
    """Run all stages, without MLflow and without files.

    Raises:
        InputError: the input is wrong.
    """
    clock = time.perf_counter()
    problem = build_problem(config, recorded)
    problem = replace(problem, config=_without_model_log(config))
    seconds: dict[str, float] = {}
    if problem.snapshots is not None:
        result = _discover_with_snapshots(problem, seconds)
    else:
        result = _discover_with_equations(problem, seconds)
    seconds["in all"] = time.perf_counter() - clock
    return result


def _discover_with_equations(problem: Problem, seconds: dict[str, float]) -> Result:
    with problem.scratch.removed_at_the_end():
        simulated = simulation_runs.simulate(problem, seconds)
        analysis = equations.discover(simulated, NullTracker(), NoCheckpoints(), seconds)
    problem = simulated.problem
    if isinstance(analysis, Resolution):
        unresolved = verification.unresolved_findings(problem, analysis)
        return _unresolved_result(problem, unresolved, seconds)
    problem = with_fitted_readings(problem, analysis.discovery.best)
    findings = verification.verify(problem, analysis)
    # What a notebook does with the result later has no bound.
    problem = replace(problem, budget=Budget())

    def write(folder: Path) -> None:
        findings_files.write_findings(problem, analysis, findings, folder)
        report.report(problem, analysis, findings, folder, {})

    return Result(
        findings=canonical(findings),
        estimates=findings_files.estimates_dataset(problem, analysis),
        forecast=findings_files.forecast_dataset(problem, analysis),
        build_corrected=partial(_corrected_simulator, problem, analysis, findings),
        figures=figures_of(problem, analysis, findings),
        main_effects=report.main_effects(problem, findings),
        write=partial(_save, problem.config, findings, seconds, write),
    )


def _unresolved_result(problem: Problem, findings: Findings, seconds: dict[str, float]) -> Result:
    def write(folder: Path) -> None:
        findings_files.freeze_findings(folder, findings, [])
        report.report_unresolved(findings, folder)

    return Result(
        findings=canonical(findings),
        estimates=None,
        forecast=None,
        build_corrected=lambda: None,
        figures={},
        main_effects=[],
        write=partial(_save, problem.config, findings, seconds, write),
    )


def _discover_with_snapshots(problem: Problem, seconds: dict[str, float]) -> Result:
    problem, runs = black_box.read_snapshots(problem, seconds)
    analysis = black_box.discover(problem, runs, NullTracker(), NoCheckpoints(), seconds)
    findings = black_box_findings.verify(problem, analysis)

    def write(folder: Path) -> None:
        black_box_findings.write(problem, analysis, findings, folder)
        black_box_report.report(problem, analysis, findings, folder, {})

    return Result(
        findings=canonical(findings),
        estimates=black_box_findings.estimates_dataset(problem, analysis),
        forecast=None,
        build_corrected=lambda: None,
        figures=black_box_report.figures_of(problem, analysis),
        main_effects=[],
        write=partial(_save, problem.config, findings, seconds, write),
    )


def _without_model_log(config: Config) -> Config:
    """Return the configuration without the MLflow model, because there is no MLflow store."""
    return replace(config, tracking=replace(config.tracking, model=False))


def _corrected_simulator(
    problem: Problem, analysis: Analysis, findings: Findings
) -> Simulator | None:
    if findings["corrected"] is None:
        return None
    law = analysis.discovery.best
    system, start = build_corrected_system(problem.system, law), law.start[0]
    return Simulator(system, lambda: start, problem.times[: len(problem.split.fit.times)])


def _save(
    config: Config, findings: Findings, seconds: dict[str, float], write: Write, folder: Path
) -> None:
    """Write the files of a run to a folder and remove those of an earlier run."""
    output = named_output(replace(config, output=str(folder)))
    assert output is not None
    clear_output(output)
    with shown_on(Silent()):
        write(output)
    write_summary(output, findings, {"findings": output})
    write_record(output, seconds, {})
