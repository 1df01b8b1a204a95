"""Weigh the law that was found against other causes: a sensor, the start, a law somewhere only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.law import Law, law_of
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import grow, minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.fit.stepwise_selection import Tried
from dashred.inference.forward.candidates import Candidate, replaced_terms
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.comparison.compare_hypotheses import (
    Additions,
    Comparison,
    compare_hypotheses,
)
from dashred.inference.hypotheses.extended.extended_library import extended_candidates
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import AMBIGUOUS
from dashred.physics.library import evaluate_terms
from dashred.physics.system import System, Term
from dashred.physics.window import window_shapes
from dashred.pipeline.discovery.first_guess_stage import FittedGuess
from dashred.pipeline.discovery.objectives import fit_noise, simulator_with
from dashred.pipeline.discovery.prior_start import fit_near_prior
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import Nominal

STEPS, TOLERANCE = 10, 1e-4
# On the last share of so many times the noise's squares hangs nothing.
HOPELESS, ROUGH = 5.0, 0.005
# Noise that is this many times the stated one is not noise.
INFLATED = 1.3
# Samples from which the simulator as it is grows, where nothing that was fitted is trusted.
FIRST = 6


def compare_explanations(
    problem: Problem,
    nominal: Nominal,
    objective: LeastSquaresProblem,
    samples: int,
    laws: Sequence[Law],
    ranked: Sequence[Tried],
    nothing: Tried,
    guess: FittedGuess,
    report: Report,
) -> Comparison:
    """Return all explanations over the whole record.

    Args:
        problem: the recording.
        nominal: the simulation that gives scales.
        objective: F of all candidates over the whole record, under the noise found so far.
        samples: how many of the record the laws were fitted to.
        laws: that act everywhere, the best first.
        ranked: their fits.
        nothing: the simulator as it is.
        guess: the best of the start; where no law could be followed to the end of the record, the
            one from which most were says nothing.
        report: progress.
    """
    best, times = ranked[0], problem.times
    reached = samples == len(objective.recorded)
    if is_noise_inflated(problem, objective.noise):
        # A sensor at fault can do that, and laws that were fitted under such noise say nothing.
        reached, objective = False, replace(objective, noise=fit_noise(problem))
    known = list(objective.forward_model.law.candidates)
    local = replaced_terms(problem.system, problem.library, known, nominal.states, times)
    everything = _with(objective, local, problem.config.discovery.weak)
    if samples < len(objective.recorded):
        everything = everything.about(guess.start)
        null, phi = everything.only(()), guess.z
    else:
        null, phi = objective.only(()), nothing.phi[: objective.modes]
    if not reached:
        phi = grow(null, phi, min(samples, FIRST))
    far = reached and nothing.cost > HOPELESS * objective.noise.count
    fitted = minimise(null, phi, STEPS, ROUGH if far else TOLERANCE)
    if not (reached and best.members):
        again = fit_near_prior(nominal.start, null, fitted.phi)
        if again is not None:
            everything, (null, fitted) = everything.about(nominal.start), again
    empty = HypothesisFit(law_of(null, fitted, fitted.cost), null, fitted.phi)
    fits = [
        HypothesisFit(law, objective.only(fit.members), fit.phi[objective.places(fit.members)])
        for law, fit in zip(laws, ranked, strict=True)
    ]
    found = fits[0] if reached else empty
    near = [fit for fit in fits[1:] if fit.law.score < laws[0].score + AMBIGUOUS]
    additions = Additions(
        global_count=len(known),
        size=_tendency_size(problem.system, nominal.states, times),
        compiled=lambda: _with_windows(problem, [*known, *local]),
        extended=lambda: extended_candidates(
            problem.system, problem.library, nominal.states, times
        ),
    )
    weighed = compare_hypotheses(
        everything, found, empty, near if reached else [], additions, report
    )
    if not reached or null.forward_model.start is not objective.forward_model.start:
        return weighed
    return _beside(weighed, laws, objective) if weighed.laws[0].parts == laws[0].parts else weighed


def _beside(weighed: Comparison, laws: Sequence[Law], objective: LeastSquaresProblem) -> Comparison:
    """Return the laws that act everywhere, where the best of them has won, beside the others.

    It keeps the fit and the rivals that the search gave it; the others their distance from it.
    """
    shift = laws[0].score - weighed.laws[0].score
    known = {law.parts for law in laws}
    others = [
        replace(law, score=law.score + shift) for law in weighed.laws if law.parts not in known
    ]
    ranked = sorted([*laws, *others], key=lambda law: law.score)
    return replace(weighed, laws=ranked, noise=objective.noise)


def is_noise_inflated(problem: Problem, noise: NoiseModel) -> bool:
    """Tell whether the noise that was found is far above what the recording says of itself."""
    stated = all(sensor.std is not None for sensor in problem.split.fit.sensors)
    ratio = float((noise.std / fit_noise(problem).std).median())
    return stated and ratio > INFLATED


def _with(
    objective: LeastSquaresProblem, local: Sequence[Candidate], weak: float
) -> LeastSquaresProblem:
    """Return F with further candidates."""
    forward_model = objective.forward_model
    law = LawBlock([*forward_model.law.candidates, *local])
    return objective.extended(
        replace(forward_model, law=law), weak * law.scales[len(objective.prior_std) :]
    )


def _with_windows(problem: Problem, candidates: Sequence[Candidate]) -> Simulator:
    return simulator_with(problem, candidates, window_shapes(problem.system))


def _tendency_size(system: System, states: Tensor, times: Tensor) -> Tensor:
    """Return the rms of each equation's own tendency over a simulation, ``(equation,)``."""
    own = [Term(field, system.equations[field]) for field in system.fields]
    return evaluate_terms(system, own, states, times).flatten(1).square().mean(dim=1).sqrt()
