"""Whether a recording can tell a hidden law from all others: foreseen by algebra, unanalysed.

About the true trajectory all laws are linear, ``H S(z, ξ) ≈ y + J_z δz + J_ξ δξ``. On readings
without noise the true form then leaves nothing, and every other form the part of ``J_ξ ξ`` that
neither its own columns nor another start can imitate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import torch
from torch import Tensor

from dashred.config import load_config
from dashred.evaluation.proof.cases.case_record import Kind
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.effect_size import Concealed
from dashred.evaluation.proof.cases.oracle import DECIDABLE, known
from dashred.evaluation.twins.recorder import expression_of
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.subset_search import ProfiledProblem, small_sets
from dashred.inference.forward.candidates import Candidate, indices_by_name
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.windows.windowed_hypothesis import Hypothesis
from dashred.inference.initial_state.start_models import nearest
from dashred.physics.system import Term
from dashred.physics.window import window_shapes
from dashred.pipeline.discovery.objectives import build_least_squares, exact_simulator
from dashred.pipeline.problem import Problem, build_problem

# Kinds whose laws act everywhere: of these alone all rivals can be listed.
FORESEEN: tuple[Kind, ...] = ("terms", "hidden", "parameter")
# Noise moves scores by some units: what shall be decidable is ahead by more without it.
CLEAR = 2 * DECIDABLE
LARGEST = 3
COMPILED: dict[str, Simulator] = {}


@torch.no_grad()
def lead(case: Case, concealed: Concealed, recording: Path) -> float:
    """Return by how much the true form is ahead of every other one, in the score of laws.

    Args:
        case: of a kind that is foreseen.
        concealed: the truth.
        recording: what the analysis will be handed.

    Returns:
        The lead over the best of all sets of up to three candidates that do not hold the true one;
        minus infinity where the trajectory blows up.
    """
    words = [f"conf={case.system}", *case.analysis_words, f"recording.path={recording}"]
    problem = build_problem(load_config(words, entry="train"))
    objective, true = _about_the_truth(case.system, problem, concealed)
    normal = objective.linearise(_unknowns(objective, true, concealed))
    if not normal.finite:
        return -torch.inf
    clean = replace(normal, residuals=torch.zeros_like(normal.residuals))
    eliminated = ProfiledProblem.of(clean, objective.modes)
    samples, shapes = objective.noise.effective_count, len(window_shapes(problem.system))

    def scores(sets: list[tuple[int, ...]]) -> Tensor:
        law = Hypothesis(tuple(range(len(sets[0]))), (), None)
        p = len(objective.prior_std)
        return eliminated.costs(sets) + law.penalty(samples, p, shapes)

    mine = float(scores([tuple(sorted(true))]))
    others = _not_holding(len(objective.prior_std), set(true))
    return min(float(scores(sets).min()) for sets in others) - mine


def _not_holding(count: int, true: set[int]) -> list[list[tuple[int, ...]]]:
    """Return all small sets, size by size, but for those that hold the true one, and more."""
    sets = ([s for s in sets if not true <= set(s)] for sets in small_sets(count, LARGEST))
    return [some for some in sets if some]


def _about_the_truth(
    name: str, problem: Problem, concealed: Concealed
) -> tuple[LeastSquaresProblem, dict[int, float]]:
    """Return F with every candidate, of the noise that was made, and the true coefficients."""
    start, library = known(name, problem)
    if name not in COMPILED:
        COMPILED[name] = exact_simulator(problem, library)
    weak = problem.config.discovery.weak
    posed = build_least_squares(problem, COMPILED[name], start, library, weak)
    noise = replace(posed.noise, std=problem.noise_of(problem.split.fit.names))
    true = chain(_terms(library, concealed), _parameters(library, concealed))
    return replace(posed, noise=noise), dict(true)


def _terms(library: Sequence[Candidate], concealed: Concealed) -> Iterator[tuple[int, float]]:
    system, index = concealed.system, indices_by_name(library)
    for hidden in concealed.truth.terms:
        term = Term(hidden.equation, expression_of(system, hidden))
        yield index[f"{term.equation}: {term}"], hidden.coefficient


def _parameters(library: Sequence[Candidate], concealed: Concealed) -> Iterator[tuple[int, float]]:
    stated = concealed.system.config.parameters
    for name, value in concealed.truth.concealed.parameters.items():
        j = next(j for j, c in enumerate(library) if name in (c.name, *c.aliases))
        yield j, value - stated[name]


def _unknowns(
    objective: LeastSquaresProblem, true: dict[int, float], concealed: Concealed
) -> Tensor:
    z = nearest(objective.forward_model.start, concealed.truth.states[0])
    xi = torch.zeros_like(objective.prior_std)
    xi[list(true)] = torch.tensor(list(true.values()), dtype=xi.dtype)
    return torch.cat([z, xi])
