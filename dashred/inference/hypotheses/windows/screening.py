"""Screening of terms and windows by linear algebra on the linearised problem.

The problem is linearised about a trajectory that a free forcing, with or without a law, has brought
to the recording. The forcing and the law are then removed. A linearisation about the uncorrected
trajectory would mislead if the mismatch is large (docs/method.md#screening).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.law_block import LawBlock, restrict_to_window
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.windows.window_columns import build_pieces, combine_pieces
from dashred.inference.hypotheses.windows.windowed_hypothesis import Hypothesis


@dataclass(frozen=True)
class ScreenedHypothesis:
    """A hypothesis with its fit on the linearised problem.

    Attributes:
        hypothesis: candidates and window.
        cost: minimum of F over the initial state and the coefficients.
        coefficients: the coefficients at this minimum.
    """

    hypothesis: Hypothesis
    cost: float
    coefficients: tuple[float, ...]


def screen(
    objective: LeastSquaresProblem,
    global_count: int,
    windowed: Sequence[int],
    forcing: FreeForcing,
    states: Tensor,
) -> list[ScreenedHypothesis]:
    """Screen single terms with every window, and every pair of terms without a window.

    Args:
        objective: F of all candidates.
        global_count: number of candidates that may act everywhere; these come first.
        windowed: indices of the candidates that may act in a window.
        forcing: a forcing that explains the recording.
        states: states of its trajectory, ``(sample, field, *grid)``; they give the range of the
            thresholds of gates.
    """
    system = objective.forward_model.simulator.system
    candidates = objective.forward_model.law.candidates
    pieces = list(build_pieces(system, candidates, windowed, objective.forward_model.times, states))
    columns = [
        *candidates,
        *(restrict_to_window([candidates[p.candidate]], p.window)[0] for p in pieces),
    ]
    stds = torch.cat([objective.prior_std, *[objective.prior_std[[p.candidate]] for p in pieces]])
    problem = profile_out(objective, forcing, columns, stds)
    screened = [_screen_columns(problem, Hypothesis((j,)), {j: 1.0}) for j in range(global_count)]
    pairs = [(i, j) for j in range(global_count) for i in range(j)]
    costs = problem.costs(pairs).tolist() if pairs else []
    for pair, cost in zip(pairs, costs, strict=True):
        coefficients = tuple(problem.coefficients(pair).tolist())
        screened.append(ScreenedHypothesis(Hypothesis(pair), cost, coefficients))
    for j, guess, weights in combine_pieces(problem, system, pieces, len(candidates)):
        screened.append(_screen_columns(problem, Hypothesis((), (j,), guess), weights))
    return screened


def profile_out(
    objective: LeastSquaresProblem, forcing: FreeForcing, columns: Sequence[Candidate], stds: Tensor
) -> ProfiledProblem:
    """Linearise about the forced trajectory, and remove the forcing and the law under it.

    Args:
        objective: F of a law.
        forcing: a forcing that explains the recording, on top of a law or of none.
        columns: candidates, with or without a window.
        stds: prior standard deviation of each coefficient, ``(column,)``.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    forced_model, places = forcing.objective.forward_model, forcing.objective.forward_model.slices
    z, xi = forcing.objective.split(forcing.phi)
    base_law = forced_model.law.terms(xi[places.law])
    # A term in a window has the same name as the term itself. Only their tangents differ.
    [readings] = forced_model.readings(z[None], xi[None])
    law = LawBlock((*columns, *base_law))
    forward_model = replace(objective.forward_model, law=law, forcing=forced_model.forcing)
    # The edges of the window of the base law stay fixed.
    base_unknowns = [*range(len(base_law)), *range(len(xi))[places.forcing]]
    priors = torch.cat([stds, forcing.objective.prior_std[base_unknowns]])
    whole = replace(objective, forward_model=forward_model, prior_std=priors)
    zero = torch.zeros(len(columns), dtype=torch.float64)
    point = torch.cat([z, zero, xi[base_unknowns]])
    # Hundreds of columns: in the plane this may take minutes.
    normal = whole.linearise(point, readings, objective.deadline)
    target = normal.target
    screened_count = objective.modes + len(columns)
    # F(φ) ≈ ‖J φ - b‖². The columns of forcing and base law are dropped, so the screened terms have
    # to explain b.
    without_base = replace(
        normal,
        jacobian=normal.jacobian[:, :screened_count],
        precision=normal.precision[:screened_count],
        phi=torch.zeros(screened_count, dtype=torch.float64),
        residuals=-target,
    )
    return ProfiledProblem.from_normal_equations(without_base, objective.modes)


def _screen_columns(
    problem: ProfiledProblem, hypothesis: Hypothesis, weights: dict[int, float]
) -> ScreenedHypothesis:
    """Return the fit of one weighted sum of columns."""
    index = list(weights)
    w = torch.tensor([weights[j] for j in index], dtype=torch.float64)
    gram = float(w @ problem.gram[index][:, index] @ w)
    goal = float(w @ problem.target[index])
    precision = float(problem.precision[index[0]])
    return ScreenedHypothesis(
        hypothesis, problem.constant - goal**2 / (gram + precision), (goal / (gram + precision),)
    )
