"""Identifiability of a hidden law from its recording, by linearisation about the truth.

Near the true trajectory, ``H S(z, ξ) ≈ y + J_z δz + J_ξ δξ``. On noise-free readings the true form
then has no residual. The residual of another form is the part of ``J_ξ ξ`` outside the span of its
own columns and of ``J_z``.
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
from dashred.evaluation.proof.cases.effect_size import CaseTruth
from dashred.evaluation.proof.cases.oracle import DECIDABLE, prior_and_library
from dashred.evaluation.twins.recorder import true_expression
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.selection.subset_search import ProfiledProblem, small_sets
from dashred.inference.forward.candidates import Candidate, indices_by_name
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.windows.windowed_hypothesis import Hypothesis
from dashred.inference.initial_state.start_models import project_state
from dashred.physics.system import Term
from dashred.physics.window import window_shapes
from dashred.pipeline.discovery.least_squares import build_least_squares, exact_simulator
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem

# Kinds whose laws act everywhere; only for these can all rivals be enumerated.
ENUMERABLE_KINDS: tuple[Kind, ...] = ("terms", "hidden", "parameter")
# Margin of a clear case. It exceeds the threshold because noise changes scores by a few units.
CLEAR_MARGIN = 2 * DECIDABLE
MAX_TERMS = 3
SIMULATOR_CACHE: dict[str, Simulator] = {}


@torch.no_grad()
def score_margin(case: Case, case_truth: CaseTruth, recording: Path) -> float:
    """Return the margin of the true form over all other forms, in the score of laws.

    Args:
        case: a case of an enumerable kind.
        case_truth: its truth.
        recording: the recording of the analysis.

    Returns:
        The margin over the best set of up to three candidates that does not contain the true set;
        minus infinity if the trajectory blows up.
    """
    words = [f"conf={case.system}", *case.analysis_words, f"recording.path={recording}"]
    problem = build_problem(load_config(words, entry="train"))
    objective, true = _problem_at_truth(case.system, problem, case_truth)
    normal = objective.linearise(_unknowns(objective, true, case_truth))
    if not normal.is_finite:
        return -torch.inf
    clean = replace(normal, residuals=torch.zeros_like(normal.residuals))
    eliminated = ProfiledProblem.from_normal_equations(clean, objective.modes)
    samples, shapes = objective.noise.effective_count, len(window_shapes(problem.system))

    def scores(sets: Tensor) -> Tensor:
        law = Hypothesis(tuple(range(len(sets[0]))), (), None)
        p = len(objective.prior_std)
        return eliminated.costs(sets) + law.penalty(samples, p, shapes)

    true_score = float(scores(torch.tensor([sorted(true)])))
    others = _other_supports(len(objective.prior_std), set(true))
    return min(float(scores(sets).min()) for sets in others) - true_score


def _other_supports(count: int, true: set[int]) -> list[Tensor]:
    """Return the small sets by size, without those that contain the true set."""
    members = torch.tensor(sorted(true), dtype=torch.int64)
    groups = []
    for sets in small_sets(count, MAX_TERMS):
        contains = (sets[:, :, None] == members).any(dim=1).all(dim=1)
        groups.append(sets[~contains])
    return [group for group in groups if len(group)]


def _problem_at_truth(
    name: str, problem: Problem, case_truth: CaseTruth
) -> tuple[LeastSquaresProblem, dict[int, float]]:
    """Return the problem with all candidates and the true noise, and the true coefficients."""
    start, library = prior_and_library(name, problem)
    if name not in SIMULATOR_CACHE:
        SIMULATOR_CACHE[name] = exact_simulator(problem, library)
    weak = problem.config.discovery.weak
    objective = build_least_squares(problem, SIMULATOR_CACHE[name], start, library, weak)
    noise = replace(objective.noise, std=problem.noise_of(problem.split.fit.names))
    true = chain(_terms(library, case_truth), _parameters(library, case_truth))
    return replace(objective, noise=noise), dict(true)


def _terms(library: Sequence[Candidate], case_truth: CaseTruth) -> Iterator[tuple[int, float]]:
    system, index = case_truth.system, indices_by_name(library)
    for hidden in case_truth.truth.terms:
        term = Term(hidden.equation, true_expression(system, hidden))
        yield index[f"{term.equation}: {term}"], hidden.coefficient


def _parameters(library: Sequence[Candidate], case_truth: CaseTruth) -> Iterator[tuple[int, float]]:
    stated = case_truth.system.config.parameters
    for name, value in case_truth.truth.concealed.parameters.items():
        j = next(j for j, c in enumerate(library) if name in (c.name, *c.aliases))
        yield j, value - stated[name]


def _unknowns(
    objective: LeastSquaresProblem, true: dict[int, float], case_truth: CaseTruth
) -> Tensor:
    z = project_state(objective.forward_model.start, case_truth.truth.states[0])
    xi = torch.zeros_like(objective.prior_std)
    xi[list(true)] = torch.tensor(list(true.values()), dtype=xi.dtype)
    return torch.cat([z, xi])
