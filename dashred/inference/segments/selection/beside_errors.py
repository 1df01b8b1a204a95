"""Laws beside errors of sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from dashred.inference.segments.selection.causes import (
    possible_errors,
    walks_of,
)
from dashred.inference.segments.selection.left_force import best_with, forces_of
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import select
from dashred.inference.segments.selection.walk_choice import Walking, walk_price
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from dashred.inference.sensor_faults.error_curve import follows_state
from dashred.inference.sensor_faults.lost_samples import first_stuck_sample

# The law explains the record if its misfit per reading is below this limit.
EXPLAINED = 1.7
# An error jumps where the readings are so many σ away, and in at most so many of all readings.
JUMP, MOST_JUMPS = 4.0, 0.1


def search_beside_errors(found: SegmentSearch) -> SegmentSearch | None:
    """Return the laws beside the sensor errors that the evidence supports; None if there are none.

    Forces are tried as well: without them an error would have to make up for a missing law. Where
    an error jumps within a segment, the readings there are left out.

    Args:
        found: the search without sensor errors.
    """
    errors = possible_errors(found.problem)
    if not errors:
        return None
    started = best_with(found, [*forces_of(found), *errors])
    kept = {cause: level for cause, level in started.causes.items() if cause.kind == "error"}
    if not kept:
        return None
    problem = replace(_without_jumps(started), walks=walks_of(kept))
    forces = len(started.problem.walks.forced)
    point = replace(started.fit.point, walked=started.fit.point.walked[:, forces:])
    laws = select(problem, problem, point)
    price = walk_price(problem, laws[0].fit.point, laws[0].members)
    beside = replace(found, problem=problem, laws=laws, errors=kept, price=price)
    is_wrong = beside.level > EXPLAINED or _repeats(beside) or _is_stuck(beside)
    return None if is_wrong else beside


def _without_jumps(walking: Walking) -> WeakConstraintProblem:
    """Return F without the readings of erring sensors that the walks cannot follow."""
    problem, point = walking.problem, walking.fit.point
    segments = problem.segments
    members = walking.members
    apart = problem.read(problem.states(point, members), point, members) - segments.readings
    jumps = np.abs(apart) > JUMP * problem.noise_stds
    sound = [s for s in range(jumps.shape[-1]) if s not in problem.walks.erring]
    jumps[:, :, sound] = False
    if jumps.sum() > MOST_JUMPS * segments.available.sum():
        return problem
    kept = replace(segments, readings=np.where(jumps, np.nan, segments.readings))
    return replace(problem, simulator=problem.simulator.with_segments(kept))


def _repeats(found: SegmentSearch) -> bool:
    """Tell whether an error has the same course in all episodes: it then follows the state.

    A steady error may be the same.
    """
    segments, walked = found.problem.segments, found.best.fit.point.walked
    episodes = [segments.episode == episode for episode in range(len(segments.begins))]
    return any(
        follows_state([walked[mine, 2 * place].tolist() for mine in episodes])
        for place, level in enumerate(found.errors.values())
        if level.name == "wandering"
    )


def _is_stuck(found: SegmentSearch) -> bool:
    """Tell whether an erring sensor is stuck: its readings stand still, and its error does not.

    This fault is no walk. It is found along one trajectory.
    """
    problem, point = found.problem, found.best.fit.point
    segments = problem.segments
    errors = np.asarray(problem.walks.errors(segments, point.walked))
    for cause in found.errors:
        sigma = float(problem.noise_std[cause.index])
        for episode in range(len(segments.begins)):
            trace, error = (
                segments.join(values[:, :, cause.index], episode)
                for values in (segments.readings, errors)
            )
            seen = np.isfinite(trace)
            begin = first_stuck_sample(torch.from_numpy(trace[seen]), sigma)
            tail = error[seen][begin:]
            if len(tail) and float(np.std(tail)) > JUMP * sigma:
                return True
    return False
