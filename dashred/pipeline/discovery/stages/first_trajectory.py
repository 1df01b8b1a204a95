"""The first trajectory: a fit of all candidates to the record, as far as one can be followed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dashred.core.progress import stage
from dashred.core.tracking import StageTracker
from dashred.inference.fit.growing_horizon import HorizonFit
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.result import Discovery
from dashred.pipeline.discovery.first_guess_stage import FittedGuess, fit_first_guesses
from dashred.pipeline.discovery.inputs import DiscoveryInputs
from dashred.pipeline.discovery.least_squares import build_least_squares, coarse_simulator
from dashred.pipeline.discovery.segments.library_choice import is_explained
from dashred.pipeline.discovery.segments.segment_horizon import follow_segments
from dashred.pipeline.discovery.segments.segment_stage import discover_in_segments
from dashred.pipeline.discovery.stages.horizon_stage import fit_from_first_guesses
from dashred.pipeline.discovery.stages.local_cause_stage import discover_local_cause

# A fit to the whole record with a larger misfit per reading does not follow it. A law that explains
# the record over segments is told then.
LOST = 100.0


@dataclass(frozen=True)
class FirstTrajectory:
    """A fit of all candidates up to its horizon.

    Attributes:
        guesses: fitted first guesses of the start, the best first.
        guess: the one from which the fit began.
        horizon: the fit.
    """

    guesses: Sequence[FittedGuess]
    guess: FittedGuess
    horizon: HorizonFit


def fit_first_trajectory(
    given: DiscoveryInputs,
    simulator: Simulator,
    candidates: Sequence[Candidate],
    child: StageTracker,
    seconds: dict[str, float],
) -> FirstTrajectory | Discovery:
    """Return the first trajectory; or the findings, if they are known without it.

    It begins with the law and the states that were found over segments, if it can follow them.
    Otherwise it grows from first guesses of the start. A cause at one place is looked for before
    that, because candidates that act everywhere cannot follow it. If no trajectory follows the
    record, the findings are those over segments, if these explain it.

    Args:
        given: recording, simulations, and results of the stages before.
        simulator: simulator with all candidates.
        candidates: terms that may be missing.
        child: tracker of the child run of the discovery.
        seconds: run time by stage, updated.
    """
    problem, nominal, segments = given.problem, given.nominal, given.segments
    settings = problem.config.discovery
    weak = settings.weak
    explained = segments is not None and is_explained(segments)
    if segments is not None and explained:
        with stage("fit one trajectory to the record", seconds):
            objective = build_least_squares(problem, simulator, nominal.start, candidates, weak)
            followed = follow_segments(objective, segments, settings.tight)
        if followed is not None:
            guess, horizon = followed
            return FirstTrajectory([guess], guess, horizon)
    coarse = coarse_simulator(problem, simulator, given.resolution)
    with stage("fit the first guesses", seconds) as report:
        guesses = fit_first_guesses(
            problem, coarse, nominal, given.ensemble, given.network, given.assimilated, report
        )
        errors = ", ".join(f"{g.name} {g.error:.2f}" for g in guesses)
        report(1.0, f"RMSE at the sensors, in σ: {errors}")
    if problem.system.axes:
        begin = guesses[0].start
        objective = build_least_squares(problem, simulator, begin, candidates, weak)
        local = discover_local_cause(problem, nominal, objective, coarse, guesses, seconds)
        if local is not None:
            return local
    with stage("grow the horizon", seconds) as report:
        guess, horizon = fit_from_first_guesses(problem, coarse, candidates, guesses, report)
    follows = horizon.is_complete and horizon.levels[-1][1] < LOST
    if segments is not None and explained and not follows:
        return discover_in_segments(problem, segments, child, seconds)
    return FirstTrajectory(guesses, guess, horizon)
