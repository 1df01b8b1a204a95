"""Look for a localised source before any law is selected, and compare it with other causes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from dashred.core.budget import NEVER
from dashred.core.progress import Report, stage
from dashred.inference.fit.first_window import first_samples
from dashred.inference.fit.law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.comparison.comparison import Comparison
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import BestOfSize, Discovery
from dashred.inference.hypotheses.sources.early_source import find_early_source
from dashred.inference.hypotheses.sources.find_source import FoundSource, refit_source
from dashred.inference.hypotheses.sources.source_law import fit_source_law
from dashred.pipeline.discovery.first_guess_stage import FittedGuess
from dashred.pipeline.discovery.hypothesis_stage import (
    compare_source,
    is_record_explained,
    tendency_size,
)
from dashred.pipeline.discovery.least_squares import build_least_squares
from dashred.pipeline.discovery.prior_start import MAX_LAW_RATIO, fit_near_prior
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun

# The fit without the source needs little accuracy, because its misfit is large.
STEPS, TOLERANCE = 10, 0.005


def find_source_first(
    problem: Problem,
    nominal: NominalRun,
    simulator: Simulator,
    candidates: Sequence[Candidate],
    guess: FittedGuess,
    report: Report,
) -> FoundSource | None:
    """Return a localised source that explains the whole recording, if there is one in time.

    Args:
        problem: recording and settings.
        nominal: simulation that gives the scale of a source.
        simulator: simulator at the resolution of the growing horizon.
        candidates: terms that may be missing.
        guess: best first guess.
        report: progress.
    """
    deadline = problem.deadline("look for a source")
    null = replace(build_least_squares(problem, simulator, guess.start, [], 1.0), deadline=deadline)
    size = tendency_size(problem.system, nominal.references[0], problem.times)
    return problem.budget.attempt(
        "a source before any law",
        lambda: find_early_source(
            null, guess.z, first_samples(null), size, len(candidates), report
        ),
        None,
    )


def discover_source(
    problem: Problem,
    nominal: NominalRun,
    objective: LeastSquaresProblem,
    source: FoundSource,
    guesses: Sequence[FittedGuess],
    seconds: dict[str, float],
) -> Discovery | None:
    """Compare a source with all other causes.

    Args:
        problem: recording and settings.
        nominal: simulation that gives the scales of the terms.
        objective: problem of all candidates over the whole record.
        source: the source, fitted with the first of the guesses.
        guesses: fitted first guesses, the best first.
        seconds: run time by stage, updated.

    Returns:
        The findings; None if the recording is not explained.
    """
    size = tendency_size(problem.system, nominal.references[0], problem.times)
    with stage("compare hypotheses", seconds) as report:
        fit = _fit_with_own_noise(objective.subset(()), nominal, source, size)
        objective = replace(objective, noise=fit.objective.noise)
        objective = objective.with_start(fit.objective.forward_model.start)
        deadline = problem.deadline("compare hypotheses")
        objective = replace(objective, deadline=deadline)
        null = replace(objective.subset(()), deadline=NEVER)
        steps = 0 if deadline.is_over else STEPS
        fitted = minimise(null, fit.phi[: null.modes], steps, TOLERANCE)
        null = replace(null, deadline=deadline)
        empty = HypothesisFit(build_law(null, fitted, fitted.cost), null, fitted.phi)
        comparison = problem.budget.attempt(
            "all other causes",
            lambda: compare_source(problem, nominal, objective, fit, empty, report),
            _uncompared(objective, fit, empty),
        )
        report(1.0, str(comparison.laws[0]))
    if not is_record_explained(problem, comparison):
        return None
    count = objective.noise.count
    nothing = BestOfSize((), (), empty.law.score, math.sqrt(fitted.cost / count))
    best = comparison.laws[0]
    return Discovery(
        laws=comparison.laws,
        uncorrected=comparison.uncorrected,
        noise=comparison.noise,
        first_guesses={g.name: g.error for g in guesses},
        first_guess=guesses[0].name,
        levels=[(len(objective.recorded), best.chi2)],
        is_horizon_complete=True,
        free_chi2=best.chi2,
        is_search_complete=True,
        path=[nothing],
        refit_count=0,
        forcing_gain=comparison.forcing_gain,
        forcing_map=comparison.forcing_map,
        source=comparison.source,
    )


def _uncompared(
    objective: LeastSquaresProblem, fit: HypothesisFit, empty: HypothesisFit
) -> Comparison:
    noise, source = objective.noise, fit.law.source
    return Comparison([fit.law, empty.law], empty.law, noise, noise, 0.0, None, source)


def _fit_with_own_noise(
    null: LeastSquaresProblem, nominal: NominalRun, source: FoundSource, size: Tensor
) -> HypothesisFit:
    """Return the law of a source under the noise that it leaves, with the prior of the start.

    The prior is used if a fit with it follows the recording as well (:func:`fit_near_prior`).
    """
    exact = refit_source(null, source, size)
    if null.forward_model.start is not nominal.start:
        law = fit_source_law(null, exact, size)
        near = fit_near_prior(nominal.start, law.objective, law.phi, MAX_LAW_RATIO)
        if near is not None:
            null = null.with_start(nominal.start)
            start = near[1].phi[: null.modes]
            exact = refit_source(null, replace(exact, fit=replace(exact.fit, phi=start)), size)
    noise = replace(exact.fit.noise(), available=null.noise.available)
    null = replace(null, noise=noise)
    return fit_source_law(null, refit_source(null, exact, size), size)
