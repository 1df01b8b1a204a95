"""Discover the law of an ODE system over segments, if no single trajectory can be fitted."""

from __future__ import annotations

import math

import numpy as np
import torch

from dashred.core.budget import Deadline
from dashred.core.progress import stage
from dashred.core.tracking import StageTracker
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.inference.hypotheses.result import BestOfSize, Discovery
from dashred.inference.segments.equivalent_laws import merge_equivalent
from dashred.inference.segments.error_growth import error_growth
from dashred.inference.segments.natural_scales import natural_scales
from dashred.inference.segments.search import SegmentLaw, SegmentSearch, search
from dashred.inference.segments.segment_laws import law_from_segments, segment_noise
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from dashred.physics.library import build_library, default_terms
from dashred.physics.tangents.ode_tangents import has_ode_tangents
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.discovery.law_metrics import log_best_by_size
from dashred.pipeline.discovery.least_squares import fit_noise
from dashred.pipeline.problem import Problem
from dashred.pipeline.segments import (
    SegmentedRecord,
    can_restart,
    resolve_steps,
    segment_record,
)
from dashred.pipeline.simulation import NominalRun

STAGE = "search over segments"
# The prior standard deviation of the first state is widened by this factor.
START_FACTOR = 3.0
# Laws that are reported, and how far from the best.
MAX_LAWS, SCORE_MARGIN = 8, 12.0
# Samples per segment; shorter segments are tried if the misfit is above this limit.
SEGMENT_SAMPLES, LOST = (4, 2, 1), 1e3
# A larger library is used if it reduces the misfit below this share.
GAIN = 0.5
# The law explains the record if its misfit per reading is below this limit.
EXPLAINED = 1.7
# If an error of the start grows by more than this factor over the record, no single trajectory is
# fitted (natural logarithm).
CHAOTIC = math.log(1e3)


def search_in_segments(
    problem: Problem, nominal: NominalRun, seconds: dict[str, float]
) -> tuple[Problem, SegmentSearch | None]:
    """Return the laws of a system without axes; None if its equations have no derivative.

    If the default library does not explain the record, the search is repeated with candidates in
    all equations, including those that look like definitions, such as ``x' = y``.

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
        found = _search(problem, nominal)
        closed = set(problem.system.fields) - {term.equation for term in problem.library}
        unexplained = found is None or not is_explained(found)
        deadline = problem.deadline(STAGE)
        if problem.config.library is None and closed and unexplained and not deadline.is_over:
            wider = _with_all_equations(problem, nominal)
            again = _search(wider, nominal)
            if again is not None and (found is None or again.level < GAIN * found.level):
                problem, found = wider, again
        if found is None:
            report(1.0, "no set of terms could be fitted")
        else:
            law = law_from_segments(found, found.best)
            report(1.0, f"{law}, χ²/n {found.level:.2f}")
    if deadline.is_over:
        problem.budget.leave_out("further sets of terms over segments")
    return problem, found


def _with_all_equations(problem: Problem, nominal: NominalRun) -> Problem:
    """Return the problem with default terms in every equation."""
    system = problem.system
    terms = default_terms(system)
    library = build_library(system, dict.fromkeys(system.fields, terms))
    return keep_identifiable_terms(
        problem.with_library(library), nominal.references[0], problem.times
    )


def _search(problem: Problem, nominal: NominalRun) -> SegmentSearch | None:
    system = problem.system
    candidates = build_candidates(system, problem.library, nominal.references[0], problem.times)
    terms = [term for candidate in candidates for term in candidate.terms]
    if not has_ode_tangents(system, terms):
        return None
    found = None
    for samples in SEGMENT_SAMPLES:
        found = _search_once(problem, nominal, candidates, samples)
        if (found is not None and found.level < LOST) or problem.deadline(STAGE).is_over:
            break
    return None if found is None else merge_equivalent(found)


def _search_once(
    problem: Problem, nominal: NominalRun, candidates: list[Candidate], samples: int
) -> SegmentSearch | None:
    """Search over segments of so many samples; None if no set of terms can be fitted.

    The time steps are first chosen at the guessed states and without candidates. They are checked
    again with the law and the states of the search. If they are too long, the search is repeated.
    """
    substeps = 1
    while True:
        record = segment_record(problem, nominal.prior.centre, nominal.prior, samples, substeps)
        found = _search_record(record, candidates, problem.deadline(STAGE))
        if found is None:
            return None
        weak, nodes = found.problem, found.best.fit.point.nodes
        noise = weak.noise_std * np.sqrt(found.level)
        terms = found.terms(found.best)
        resolved = resolve_steps(weak.simulator, weak.sensors, noise, nodes, *terms)
        fine = resolved.substeps == weak.simulator.substeps
        if fine or found.level > LOST or weak.deadline.is_over:
            return found
        substeps = resolved.substeps


def _search_record(
    record: SegmentedRecord, candidates: list[Candidate], deadline: Deadline
) -> SegmentSearch | None:
    scales = natural_scales(
        record.simulator, record.sensors, candidates, record.guesses[-1], record.size
    )
    weak = WeakConstraintProblem(
        simulator=record.simulator,
        sensors=record.sensors,
        candidates=tuple(candidates),
        noise_std=record.noise_std,
        model_error=np.ones(len(record.size)),
        start_mean=record.start_mean,
        start_std=START_FACTOR * record.start_std,
        prior_std=scales.coefficient,
        deadline=deadline,
    )
    found = search(weak, record.guesses, scales)
    return found if math.isfinite(found.best.score) else None


def is_explained(found: SegmentSearch) -> bool:
    """Return whether the residuals of the best law are noise."""
    return found.level < EXPLAINED


def is_chaotic(found: SegmentSearch) -> bool:
    """Return whether an error of the start grows too much to fit a single trajectory."""
    return error_growth(found) > CHAOTIC


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
    explained = is_explained(found)
    near = [law for law in found.laws if law.score < found.best.score + SCORE_MARGIN][:MAX_LAWS]
    empty = next(law for law in found.laws if not law.members)
    with stage("fit the law to the end", seconds) as report:
        laws = [law_from_segments(found, law) for law in near]
        uncorrected = law_from_segments(found, empty)
        path = _best_by_size(found)
        log_best_by_size(run, path)
        report(1.0, str(laws[0]))
    count, level = len(problem.split.fit.times), found.level
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
        forcing_gain=0.0 if explained else (level - 1) * found.problem.segments.seen,
    )


def _best_by_size(found: SegmentSearch) -> list[BestOfSize]:
    best: dict[int, SegmentLaw] = {}
    for law in found.laws:
        if math.isfinite(law.score):
            best.setdefault(len(law.members), law)
    seen = found.problem.segments.seen
    path = []
    for _, law in sorted(best.items()):
        candidates, xi = found.terms(law)
        rmse = math.sqrt(law.fit.cost / seen / found.level)
        path.append(BestOfSize(candidates, tuple(xi.tolist()), law.score, rmse))
    return path
