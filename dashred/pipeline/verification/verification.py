"""Compute the errors on held-out data and build the findings."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from dashred.core.findings.cause_schema import Cause
from dashred.core.findings.fit_schema import Doubt, Fit
from dashred.core.findings.schema import (
    Findings,
    Latent,
    LatentSindy,
    PathStep,
    Proposal,
    new_findings,
)
from dashred.inference.latent_sindy.sparse_regression import SparseFit
from dashred.inference.results.explanation import (
    also_supported,
    alternatives,
    smaller_laws,
    terms_of_discovery,
)
from dashred.inference.results.fitted_parameters import fitted_parameters
from dashred.inference.results.hidden_state import hidden_state, tell_hidden_state
from dashred.inference.results.location import locate
from dashred.inference.results.verdict import unexplained_share, verdict, with_faults
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.outputs.corrected_config import NAME as CORRECTED
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.numerical_error import numerical_error, sufficient_step
from dashred.pipeline.simulation.state_samples import within_range
from dashred.pipeline.verification.comparison import compare_held_out, misfits_at_sensors
from dashred.pipeline.verification.confirmation import contradiction_of_faults, is_law_contradicted
from dashred.pipeline.verification.energy import energy_loss
from dashred.pipeline.verification.few_readings import (
    are_too_few,
    fitted_readings,
    start_values,
)
from dashred.pipeline.verification.findings_input import build_input
from dashred.pipeline.verification.held_out import (
    held_out_errors,
    held_out_samples,
    predict_held_out,
)
from dashred.pipeline.verification.held_out_faults import err_next_to, held_out_faults
from dashred.pipeline.verification.sensor_noise import noise_of_sensors
from dashred.pipeline.verification.spent_budget import blame_budget, note_budget
from dashred.pipeline.verification.structure import structure_change
from dashred.reporting.wording.findings_text import add_text


def verify(problem: Problem, analysis: Analysis) -> Findings:
    """Compare every method with the held-out data and return the findings."""
    discovered = analysis.discovery
    units = problem.system.units
    names = problem.split.fit.names
    stated = problem.noise_of(names).repeat(len(problem.episodes))
    left = unexplained_share(stated, discovered.noise)
    predictions = predict_held_out(problem, analysis)
    comparisons = compare_held_out(predictions)
    scale = torch.from_numpy(problem.split.fit.trace_scale())
    residual = float((discovered.noise.std[: len(names)] / scale).median())
    kind, causes = verdict(discovered, left, problem.fault_details, residual)
    noise = noise_of_sensors(problem, analysis, problem.split.tested.names)
    misfits = misfits_at_sensors(predictions["test_sensors"], noise)
    faults = [] if kind == "not-converged" else held_out_faults(problem, analysis)
    is_local = err_next_to(problem, discovered.best.faults, faults)
    readings, start = fitted_readings(problem), start_values(problem)
    doubt: Doubt | None = None
    if kind == "sensor-fault":
        share = float((problem.noise_of(names) / scale).median())
        doubt = contradiction_of_faults(comparisons, misfits, is_local, share)
    elif is_law_contradicted(kind, causes, discovered.best, comparisons):
        doubt = "worse"
    elif are_too_few(kind, len(discovered.best.candidates), readings, start):
        doubt = "few-readings"
    kind = kind if doubt is None else "unconfirmed"
    kind, causes = with_faults(kind, causes, map(problem.fault_details, faults))
    # The residuals have the same σ in all episodes.
    law, std = discovered.best, discovered.noise.std[: len(names)]
    # Without a law that is told, its numerical error says nothing.
    is_told = kind != "not-converged"
    error = numerical_error(problem, law, std) if is_told else None
    too_large = error is not None and error > 1
    fit = Fit(
        comparisons=comparisons,
        noise_std=problem.noise,
        residual_std=dict(zip(names, std.tolist(), strict=True)),
        readings=readings,
        start_values=start,
        held_out_samples=held_out_samples(predictions),
        noise_correlation=float(discovered.noise.correlation.max()),
        own_error=error,
        failure=None if problem.system.program is None else problem.system.program.failure,
        sufficient_dt=sufficient_step(problem, law, std) if too_large else None,
        corrected_dt=analysis.trajectories.shortest_dt if is_told else None,
        diverges=analysis.trajectories.first_diverges if is_told else None,
        chi2=discovered.best.chi2,
        unexplained=left,
        misfit_at_test_sensors=misfits or None,
        outside_basis=_outside_basis(problem, analysis) if is_told else None,
        unconfirmed=doubt,
        **held_out_errors(predictions),
    )
    proposed = {n: proposals(problem, f) for n, f in analysis.assimilated.proposals.items()}
    # An expensive program leaves no time for them.
    nothing = LatentSindy(proposals=[], rmse_path=[])
    latent = Latent(alg1=proposed.get("alg1", nothing), alg2=proposed.get("alg2", nothing))
    if "dynamics" in proposed:
        latent["dynamics"] = proposed["dynamics"]
        latent["dynamics"]["parameters"] = dict(analysis.assimilated.parameters)
    count = len(problem.split.fit.times)
    if kind == "not-converged":
        blame_budget(causes[0], problem.budget)
        # No law is told: where and when the simulator misses the recording is known all the same.
        without = replace(discovered, laws=[discovered.uncorrected])
        states = analysis.trajectories.states["simulation_refit"]
        failed = new_findings(
            build_input(problem),
            fit=fit,
            latent=latent,
            verdict=kind,
            causes=causes,
            where=locate(
                problem.system,
                without,
                states[:count],
                problem.times[:count],
                names,
                stated,
                within_range(problem, states[:count]),
            ),
            units=units,
        )
        note_budget(failed, problem.budget)
        return add_text(failed, problem.system)
    states = analysis.trajectories.states["corrected"][:count]
    hidden = hidden_state(problem.system, discovered.best, problem.hidden)
    tell_hidden_state(causes, hidden)
    findings = new_findings(
        build_input(problem),
        fit=fit,
        latent=latent,
        verdict=kind,
        causes=causes,
        where=locate(
            problem.system,
            discovered,
            states,
            problem.times[:count],
            names,
            stated,
            within_range(problem, states),
        ),
        terms=terms_of_discovery(problem.system, discovered),
        fitted_parameters=[
            each
            for each in fitted_parameters(problem.system, discovered.best, problem.described)
            if problem.hidden is None or each["parameter"] != problem.hidden.constant
        ],
        hidden_state=hidden,
        alternatives=alternatives(discovered, problem.system),
        smaller=smaller_laws(discovered, problem.system),
        also_supported=also_supported(discovered, problem.system),
        energy=energy_loss(
            problem.system,
            discovered.best,
            problem.times[:count],
            problem.rng("energy"),
        ),
        structure=structure_change(
            problem.system,
            discovered.best,
            problem.times[:count],
            analysis.trajectories.states["corrected"][:count],
        ),
        corrected=CORRECTED,
        units=units,
    )
    note_budget(findings, problem.budget)
    return add_text(findings, problem.system)


def _outside_basis(problem: Problem, analysis: Analysis) -> float | None:
    """Return what SHRED's modes cannot express of the corrected field; None if that is no number.

    The corrected simulator stands for the real field, which nobody knows.
    """
    states = analysis.trajectories.states["corrected"][: len(problem.split.fit.times)]
    share = analysis.network.shred.pod.left_out(states)
    return share if math.isfinite(share) else None


def unresolved_findings(problem: Problem, resolution: Resolution) -> Findings:
    """Return the findings of a simulator whose numerical error is too large to fit a law."""
    # The grid of a program is its own.
    axes = problem.system.axes if problem.system.program is None else ()
    points = {axis.name: axis.points for axis in axes}
    enough = None
    if resolution.enough is not None:
        enough = {name: count * resolution.enough for name, count in points.items()}
    cause: Cause = {
        "kind": "unresolved-numerics",
        "probability": None,
        "doubling_error": resolution.error,
        "limit": resolution.limit,
        "points": points,
        "enough": enough,
    }
    findings = new_findings(
        build_input(problem),
        verdict="unresolved-numerics",
        causes=[cause],
        units=problem.system.units,
    )
    note_budget(findings, problem.budget)
    return add_text(findings, problem.system)


def proposals(problem: Problem, fit: SparseFit) -> LatentSindy:
    """Return the proposals of one of the two algorithms, best first."""
    proposed = [
        Proposal(
            equation=problem.library[j].equation,
            term=str(problem.library[j]),
            coefficient=float(fit.coefficients[j]),
            inclusion=float(fit.inclusion[j]),
            rank=rank,
        )
        for rank, j in enumerate(fit.ranking, start=1)
    ]
    path = [PathStep(terms=terms, rmse=rmse) for terms, rmse in fit.path]
    return LatentSindy(proposals=proposed, rmse_path=path)
