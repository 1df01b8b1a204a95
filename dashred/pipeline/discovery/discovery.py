"""Discover: fit the start and a sparse law together, through the simulator, to the sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch

from dashred.core.mlflow.metric_names import metric_name
from dashred.core.progress import stage
from dashred.core.tracking import RunTracker
from dashred.inference.fit.law import Law, posterior
from dashred.inference.fit.stepwise_selection import Selection, Tried, better, polish, select
from dashred.inference.forward.candidates import Candidate, build_candidates, indices_by_name
from dashred.inference.hypotheses.comparison.compare_hypotheses import Comparison
from dashred.inference.hypotheses.result import MISSING, BestOfSize, Discovery
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline.assimilation import AssimilationResult
from dashred.pipeline.discovery.first_guess_stage import fit_first_guesses
from dashred.pipeline.discovery.horizon_stage import (
    fit_from_first_guesses,
    walk_on,
    with_noise_after,
)
from dashred.pipeline.discovery.hypothesis_stage import compare_explanations, is_noise_inflated
from dashred.pipeline.discovery.objectives import (
    build_least_squares,
    coarse_simulator,
    exact_simulator,
)
from dashred.pipeline.discovery.prior_start import select_near_prior
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import Nominal
from dashred.pipeline.training import TrainedNetwork

# A step that gains a smaller share of F ends a fit: of the law, and of the simulator as it is,
# whose misfit is so large that more would be spent for nothing.
POLISHED, SETTLED = 1e-5, 1e-3
# Rivals that are kept, with their distance from the best.
KEPT = 6
NEAR = 12.0


@torch.no_grad()
def discover(
    problem: Problem,
    nominal: Nominal,
    resolution: Resolution,
    ensemble: Ensemble,
    learned: TrainedNetwork,
    found: AssimilationResult,
    run: RunTracker,
    seconds: dict[str, float],
) -> Discovery:
    """Guess the start, walk the horizon, select, and fit to the end.

    See docs/method.md#fit-through-the-simulator.
    """
    candidates = build_candidates(problem.system, problem.library, nominal.states, problem.times)
    proposals = _proposals(problem, candidates, found)
    with run.child("discover") as child:
        with stage("seed the start", seconds) as report:
            simulator = exact_simulator(problem, candidates)
            coarse = coarse_simulator(problem, simulator, resolution)
            guesses = fit_first_guesses(problem, coarse, nominal, ensemble, learned, found, report)
            report(
                1.0, ", ".join(f"{g.name} {g.error:.2f}" for g in guesses) + " σ off its sensors"
            )
        errors = {f"seed/{g.name}": g.error for g in guesses if math.isfinite(g.error)}
        child.log_metrics(errors, 0)
        with stage("grow the horizon", seconds) as report:
            guess, walked = fit_from_first_guesses(problem, coarse, candidates, guesses, report)
            child.set_tags({"seed of the start": guess.name})
        for samples, level in walked.levels:
            child.log_metrics({"horizon/chi2": level}, samples)
            run.log_metrics({"horizon/chi2": level}, samples)
        weak = problem.config.discovery.weak
        objective = build_least_squares(problem, simulator, guess.start, candidates, weak)
        objective = with_noise_after(objective, walked)
        with stage("select the law", seconds) as report:
            selection = select(objective.until(walked.samples), walked.phi, proposals, report)
            if not walked.reached:
                walked, selection = walk_on(objective, walked, selection, proposals, report)
            selection = select_near_prior(nominal.start, selection, KEPT, report)
            objective = objective.about(selection.objective.forward_model.start)
            report(1.0, f"{len(selection.tried)} sets refitted")
        with stage("fit the law to the end", seconds) as report:
            laws, ranked, nothing = _finish(selection)
            report(1.0, str(laws[0]))
        with stage("weigh other causes", seconds) as report:
            seen = replace(selection.objective.noise, seen=objective.noise.seen)
            whole, reach = replace(objective, noise=seen), walked.samples
            weighed = compare_explanations(
                problem, nominal, whole, reach, laws, ranked, nothing, guesses[0], report
            )
            report(1.0, str(weighed.laws[0]))
        path = _path(selection, nothing)
        for best_of in path:
            scores = {"evidence/score": best_of.score, "evidence/rmse": best_of.rmse}
            child.log_metrics(scores | _coefficients(best_of), len(best_of.candidates))
    part = selection.objective
    free = part.noise.whiten(walked.readings - part.recorded).square().sum()
    return Discovery(
        laws=weighed.laws,
        nothing=weighed.nothing,
        noise=weighed.noise,
        first_guesses={g.name: g.error for g in guesses},
        first_guess=guess.name,
        levels=walked.levels,
        reached=walked.reached or _explains(problem, weighed),
        # A walk that got lost says nothing of what can be reached over the whole record.
        free_chi2=float(free) / part.noise.count if walked.reached else weighed.laws[0].chi2,
        exhausted=selection.exhausted,
        path=path,
        tried=len(selection.tried),
        forcing_gain=weighed.gain,
        forcing=weighed.forcing,
    )


def _coefficients(best: BestOfSize) -> dict[str, float]:
    """Return the coefficients of the best law of a size, by their names in MLflow."""
    return {
        metric_name("coef", candidate.equation or "parameter", candidate.name): value
        for candidate, value in zip(best.candidates, best.coefficients, strict=True)
    }


def _explains(problem: Problem, weighed: Comparison) -> bool:
    """Tell whether another cause explains the whole record, where no law everywhere could follow.

    What is fitted to all of it, and leaves nothing to a free forcing, has got lost nowhere: if what
    it leaves is noise.
    """
    if is_noise_inflated(problem, weighed.noise):
        return False
    best = weighed.laws[0]
    found = best.window is not None or best.fault is not None or best.widened > 1
    return found or weighed.gain <= MISSING


def _proposals(
    problem: Problem, candidates: Sequence[Candidate], found: AssimilationResult
) -> list[tuple[int, ...]]:
    """Return the sets that Algorithms 1 and 2 propose, as candidates."""
    index = indices_by_name(candidates)
    names = [f"{term.equation}: {term}" for term in problem.library]
    sets = []
    for fit in found.proposals.values():
        chosen = {index[name] for name, value in zip(names, fit.coefficients, strict=True) if value}
        sets.append(tuple(sorted(chosen)))
    return [members for members in sets if members]


def _finish(selection: Selection) -> tuple[list[Law], list[Tried], Tried]:
    """Fit the best law and the empty one to the end; rivals stay as the search left them.

    Returns:
        The laws, the best first; their fits; that of the empty one.
    """
    objective = selection.objective
    best = polish(objective, selection.tried[0], POLISHED)
    normal = objective.linearise(best.phi)
    near = [t for t in selection.tried[1:] if t.score < best.score + NEAR][:KEPT]
    single = next((t for t in selection.tried if len(t.members) == 1), None)
    if single is not None and len(best.members) > 1 and all(t is not single for t in near):
        near.append(single)
    nothing = polish(objective, _empty(selection, best), SETTLED) if best.members else best

    def law(tried: Tried) -> Law:
        [readings] = objective.forward_model.readings(*objective.split(tried.phi[None]))
        return posterior(objective, normal, tried.phi, tried.members, readings, tried.score)

    ranked = sorted([best, *near], key=lambda tried: tried.score)
    return [law(tried) for tried in ranked], ranked, nothing


def _empty(selection: Selection, best: Tried) -> Tried:
    """Return the better beginning for the empty law: as the search left it, or the best's start."""
    objective = selection.objective
    left = next(tried for tried in selection.tried if not tried.members)
    moved = objective.embed(best.phi[: objective.modes], [])
    phi, cost = better(objective, left.phi, moved)
    return Tried((), phi, cost, cost)


def _path(selection: Selection, nothing: Tried) -> list[BestOfSize]:
    """Return the best law of each size that was tried, and none as it was fitted to the end."""
    objective = selection.objective
    known = objective.forward_model.law.candidates
    best: dict[int, Tried] = {}
    for tried in (nothing, *selection.tried):
        if math.isfinite(tried.score):
            best.setdefault(len(tried.members), tried)
    return [
        BestOfSize(
            tuple(known[j] for j in tried.members),
            tuple(float(tried.phi[objective.modes + j]) for j in tried.members),
            tried.score,
            math.sqrt(tried.cost / objective.noise.count),
        )
        for _, tried in sorted(best.items())
    ]
