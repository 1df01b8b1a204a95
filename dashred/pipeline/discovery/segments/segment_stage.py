"""Discover the law of an ODE system over segments, if no single trajectory can be fitted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from dashred.core.progress import stage
from dashred.core.tracking import StageTracker
from dashred.inference.fit.forecast_choice import MOST_TERMS
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.result import BestOfSize, Discovery
from dashred.inference.segments.findings.force_map import force_map
from dashred.inference.segments.findings.forecast import sufficient_law
from dashred.inference.segments.findings.segment_laws import law_from_segments, segment_noise
from dashred.inference.segments.selection.left_force import left_force
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw
from dashred.pipeline.discovery.headline_law import terms_beside
from dashred.pipeline.discovery.law_metrics import log_best_by_size
from dashred.pipeline.discovery.least_squares import fit_noise
from dashred.pipeline.discovery.segments.library_choice import (
    is_explained,
    search_libraries,
)
from dashred.pipeline.discovery.segments.relinearisation import about_fitted_parameters
from dashred.pipeline.discovery.segments.segment_search import STAGE
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.numerical_error import VISIBLE, numerical_error, sufficient_step
from dashred.pipeline.simulation.program_cost import follows_segments
from dashred.pipeline.simulation.segmented_record import can_restart

# Laws that are reported, and how far from the best.
MAX_LAWS, SCORE_MARGIN = 8, 12.0
# Searches about other values of uncertain parameters.
PARAMETER_ROUNDS = 4


def search_in_segments(
    problem: Problem, nominal: NominalRun, seconds: dict[str, float]
) -> tuple[Problem, SegmentSearch | None]:
    """Return the laws of a system without axes; None if its equations have no derivative.

    Args:
        problem: recording, system and library.
        nominal: simulation that gives the prior of the start and the scales.
        seconds: run time by stage, updated.

    Returns:
        The problem, with the library that was needed; and the laws.
    """
    if not can_restart(problem):
        return problem, None
    with stage(STAGE, seconds) as report, np.errstate(all="ignore"):
        began = problem.budget.spent
        problem, found = _search_about_parameters(problem, nominal)
        if found is not None:
            took = problem.budget.spent - began
            problem, found = _search_with_own_step(problem, nominal, found, took)
        if found is None:
            report(1.0, "no set of terms could be fitted")
        else:
            law = law_from_segments(found, found.best)
            report(1.0, f"{law}, χ²/n {found.level:.2f}")
    if problem.deadline(STAGE).is_over:
        problem.budget.leave_out("further sets of terms over segments")
    return problem, found


def _search_about_parameters(
    problem: Problem, nominal: NominalRun
) -> tuple[Problem, SegmentSearch | None]:
    """Search about the fitted values of uncertain parameters, until these stay."""
    searched, found = search_libraries(problem, nominal)
    for _ in range(PARAMETER_ROUNDS):
        values = None if found is None else about_fitted_parameters(searched, found)
        if values is None or problem.deadline(STAGE).is_over:
            break
        again, better = search_libraries(problem.with_parameters(values), nominal)
        if better is None or problem.deadline(STAGE).is_over:
            break
        searched, found = again, better
    return searched, found


def _search_with_own_step(
    problem: Problem, nominal: NominalRun, found: SegmentSearch, took: float
) -> tuple[Problem, SegmentSearch]:
    """Search again with a shorter time step if the law needs one, and the step was not stated.

    The step was chosen for the simulation without the law. The search is not begun if there is no
    time for it, or, with an expensive program, if it would not come to its end.

    Args:
        problem: recording, system and library.
        nominal: simulation that gives the prior of the start and the scales.
        found: the laws.
        took: seconds of the search that found them.
    """
    stated = problem.config.system.integrator.dt is not None
    is_expensive = follows_segments(problem)
    if stated or (is_expensive and problem.deadline(STAGE).is_over):
        return problem, found
    law = law_from_segments(found, found.best)
    noise = segment_noise(found, fit_noise(problem)).std[: len(problem.split.fit.names)]
    error = numerical_error(problem, law, noise)
    is_visible = error is not None and error > VISIBLE
    dt = sufficient_step(problem, law, noise) if is_visible else None
    if dt is None:
        return problem, found
    finer = problem.with_step(dt, f"then {dt:.6g}, which the law needs")
    needed = took * problem.system.dt / dt if is_expensive else 0.0
    if finer.deadline(STAGE).is_over_in(needed):
        problem.budget.leave_out(f"the time step of {dt:.6g} that the law needs")
        return problem, found
    searched, better = _search_about_parameters(finer, nominal)
    return (problem, found) if better is None else (searched, better)


def with_few_terms(found: SegmentSearch) -> SegmentSearch:
    """Return the search with the law of the headline in the first place.

    A law of many members is reduced to those that its forecast needs, which may be all of them.
    """
    if len(found.best.members) <= MOST_TERMS:
        return found
    return found.with_best(sufficient_law(found))


def has_sensor_errors(found: SegmentSearch) -> bool:
    """Return whether the best law explains the record together with sensor errors."""
    return is_explained(found) and bool(found.errors)


@torch.no_grad()
def discover_in_segments(
    problem: Problem, found: SegmentSearch, run: StageTracker, seconds: dict[str, float]
) -> Discovery:
    """Return the findings of a segment search.

    Args:
        problem: the recording.
        found: the laws.
        run: tracker of the child run of the discovery.
        seconds: run time by stage, updated.
    """
    supported, found = found.best, with_few_terms(found)
    near = [law for law in found.laws if law.score < found.best.score + SCORE_MARGIN][:MAX_LAWS]
    empty = next(law for law in found.laws if not law.members)
    with stage("fit the law to the end", seconds) as report:
        laws = [law_from_segments(found, law) for law in near]
        uncorrected = replace(law_from_segments(found, empty), faults=())
        path = _best_by_size(found)
        log_best_by_size(run, path)
        report(1.0, str(laws[0]))
    count, level = len(problem.split.fit.times), found.level
    unexplained = 0.0 if is_explained(found) else (level - 1) * found.problem.segments.seen
    left = left_force(found, found.walking(found.best))
    noise: NoiseModel = segment_noise(found, fit_noise(problem))
    return Discovery(
        laws=laws,
        uncorrected=uncorrected,
        noise=noise,
        first_guesses={},
        first_guess="segments",
        levels=[(count, level)],
        is_horizon_complete=True,
        free_chi2=laws[0].chi2,
        is_search_complete=True,
        path=path,
        refit_count=len(found.laws),
        forcing_gain=max(unexplained, left.gain if left is not None else 0.0),
        forcing_map=None if left is None else force_map(left),
        also_supported=terms_beside(laws[0], *found.terms(supported)),
    )


def _best_by_size(found: SegmentSearch) -> list[BestOfSize]:
    best: dict[int, SegmentLaw] = {}
    for law in found.laws:
        if math.isfinite(law.score):
            best.setdefault(len(found.terms(law)[0]), law)
    seen = found.problem.segments.seen
    path = []
    for _, law in sorted(best.items()):
        candidates, xi = found.terms(law)
        rmse = math.sqrt(law.fit.cost / seen / found.level)
        path.append(BestOfSize(candidates, tuple(xi.tolist()), law.score, rmse))
    return path
