"""Select the terms along the first trajectory, and fit the laws to the end of the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dashred.core.progress import stage
from dashred.inference.fit.forecast_choice import MOST_TERMS
from dashred.inference.fit.growing_horizon import HorizonFit
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.fit.selection.stepwise_selection import RefittedSet, Selection, select
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.simulator import Simulator
from dashred.pipeline.discovery.headline_law import Headline, headline_law
from dashred.pipeline.discovery.inputs import DiscoveryInputs
from dashred.pipeline.discovery.least_squares import build_least_squares
from dashred.pipeline.discovery.prior_start import select_near_prior
from dashred.pipeline.discovery.segments.segment_stage import with_few_terms
from dashred.pipeline.discovery.selected_laws import MAX_RIVALS, fit_best
from dashred.pipeline.discovery.stages.first_trajectory import FirstTrajectory
from dashred.pipeline.discovery.stages.horizon_stage import (
    extend_horizon,
    selection_prior,
    with_residual_noise,
)


@dataclass(frozen=True)
class SelectedLaws:
    """The laws that act everywhere.

    Attributes:
        objective: F of all candidates over the whole record.
        horizon: the fit from which the terms were selected.
        selection: every set of candidates that was refitted.
        laws: the best law and its rivals, the best first.
        ranked: their fits.
        nothing: the fit of the empty law.
        uncorrected: the empty law.
        told: the law of a few terms in the place of a best law of many; None without one.
    """

    objective: LeastSquaresProblem
    horizon: HorizonFit
    selection: Selection
    laws: list[Law]
    ranked: list[RefittedSet]
    nothing: RefittedSet
    uncorrected: Law
    told: Headline | None

    @property
    def noise(self) -> NoiseModel:
        """The noise that the best law leaves, for all samples of the record."""
        return self.selection.objective.noise.over(self.objective.noise)


def select_laws(
    given: DiscoveryInputs,
    simulator: Simulator,
    candidates: Sequence[Candidate],
    first: FirstTrajectory,
    proposals: list[tuple[int, ...]],
    seconds: dict[str, float],
) -> SelectedLaws:
    """Select the terms, and fit the best laws until convergence.

    Args:
        given: recording, simulations, and results of the stages before.
        simulator: simulator with all candidates.
        candidates: terms that may be missing.
        first: the first trajectory.
        proposals: sets of candidates that are tried in any case.
        seconds: run time by stage, updated.
    """
    objective, horizon, selection = _select_terms(
        given, simulator, candidates, first, proposals, seconds
    )
    problem = given.problem
    with stage("fit the law to the end", seconds) as report:
        deadline = problem.deadline("fit the law to the end")
        selection = replace(selection, objective=replace(selection.objective, deadline=deadline))
        laws, ranked, nothing, uncorrected = fit_best(selection)
        report(1.0, str(laws[0]))
        told = None
        if not _needs_many_terms(given):
            told = problem.budget.attempt(
                "forecasts of smaller laws", lambda: headline_law(selection, laws[0].score), None
            )
    return SelectedLaws(objective, horizon, selection, laws, ranked, nothing, uncorrected, told)


def _needs_many_terms(given: DiscoveryInputs) -> bool:
    """Tell whether the forecasts over segments need a law of many terms."""
    segments = given.segments
    return segments is not None and len(with_few_terms(segments).best.members) > MOST_TERMS


def _select_terms(
    given: DiscoveryInputs,
    simulator: Simulator,
    candidates: Sequence[Candidate],
    first: FirstTrajectory,
    proposals: list[tuple[int, ...]],
    seconds: dict[str, float],
) -> tuple[LeastSquaresProblem, HorizonFit, Selection]:
    """Return F over the whole record, the fit that was selected from, and the selection."""
    problem, horizon = given.problem, first.horizon
    settings = problem.config.discovery
    prior = settings.weak
    if horizon.widened:
        proposals = [horizon.widened, *proposals]
        prior = selection_prior(settings.tight, settings.weak, horizon)
    objective = build_least_squares(problem, simulator, first.guess.start, candidates, prior)
    deadline = problem.deadline("select the law")
    objective = replace(with_residual_noise(objective, horizon), deadline=deadline)
    with stage("select the law", seconds) as report:
        selection = select(objective.truncate(horizon.samples), horizon.phi, proposals, report)
        if not horizon.is_complete:
            horizon, selection = extend_horizon(objective, horizon, selection, proposals, report)
        selection = select_near_prior(given.nominal.start, selection, MAX_RIVALS, report)
        objective = objective.with_start(selection.objective.forward_model.start)
        report(1.0, f"{len(selection.tried)} sets refitted")
    if not selection.exhausted and deadline.is_over:
        problem.budget.leave_out("further sets of terms")
    return objective, horizon, selection
