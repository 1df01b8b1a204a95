"""Search for the law of an ODE system over segments of its recording, with a given library."""

from __future__ import annotations

import math

import numpy as np

from dashred.core.budget import Deadline
from dashred.inference.fit.noise_model import LEAST_NOISE
from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.inference.forward.parameter_block import split_parameters
from dashred.inference.segments.natural_scales import natural_scales
from dashred.inference.segments.selection.equivalent_laws import merge_equivalent
from dashred.inference.segments.selection.plainer_unit import in_plainer_unit
from dashred.inference.segments.selection.search import SegmentSearch, search
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from dashred.physics.tangents.ode_tangents import has_ode_tangents
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.segment_resolution import resolve_steps
from dashred.pipeline.simulation.segmented_record import SegmentedRecord, segment_record
from dashred.pipeline.simulation.state_samples import state_samples

STAGE = "search over segments"
# The prior standard deviation of the first state is widened by this factor.
START_FACTOR = 3.0
# Samples per segment; shorter segments are tried if the misfit is above this limit.
SEGMENT_SAMPLES, LOST = (4, 2, 1), 1e3


def search_library(problem: Problem, nominal: NominalRun) -> SegmentSearch | None:
    """Return the laws of the library; None if none can be fitted or differentiated.

    Args:
        problem: recording, system and library.
        nominal: simulation that gives the prior of the start and the scales.
    """
    system = problem.system
    reference = state_samples(problem, nominal)
    candidates = build_candidates(
        reference.system,
        problem.library,
        reference.states,
        reference.times,
        priors=problem.parameter_priors,
        let_terms=problem.let_terms,
        moved=reference.moved,
    )
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
    problem: Problem,
    nominal: NominalRun,
    candidates: list[Candidate],
    samples: int,
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
        changes = weak.changes(found.best.fit.point, found.best.members)
        resolved = resolve_steps(weak.simulator, weak.sensors, noise, nodes, *changes)
        fine = resolved.substeps == weak.simulator.substeps
        if fine or found.level > LOST or weak.deadline.is_over:
            return found
        substeps = resolved.substeps


def _search_record(
    record: SegmentedRecord, found: list[Candidate], deadline: Deadline
) -> SegmentSearch | None:
    parameters, candidates = split_parameters(found)
    scales = natural_scales(
        record.simulator,
        record.sensors,
        candidates,
        record.guesses[-1],
        record.size,
        record.noise_std,
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
        parameters=parameters,
        least_std=LEAST_NOISE * record.noise_std,
        deadline=deadline,
    )
    searched = in_plainer_unit(search(weak, record.guesses, scales))
    return searched if math.isfinite(searched.best.score) else None
