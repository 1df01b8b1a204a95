"""Which terms, and where: every term by cells, by times and by states, linearised, only algebra.

The columns are taken about a trajectory that a free forcing, or a law under one, has brought to the
recording, with forcing and law taken out: about the uncorrected trajectory a large mismatch
misleads (docs/method.md#screening).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.law_block import LawBlock, restrict_to_window
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.windows.window_columns import pieces_of, windows_of
from dashred.inference.hypotheses.windows.windowed_hypothesis import Hypothesis


@dataclass(frozen=True)
class Screened:
    """A hypothesis as the linearised problem sees it.

    Attributes:
        hypothesis: candidates and window.
        cost: F, start and coefficients at their best.
        coefficients: these.
    """

    hypothesis: Hypothesis
    cost: float
    coefficients: tuple[float, ...]


def screen(
    objective: LeastSquaresProblem,
    global_count: int,
    windowed: Sequence[int],
    forced: FreeForcing,
    states: Tensor,
) -> list[Screened]:
    """Return single terms with every window, and every pair of terms everywhere.

    Args:
        objective: F of all candidates.
        global_count: how many of these, the first, may act everywhere.
        windowed: those that may act in a window.
        forced: a forcing that explains the recording.
        states: of its trajectory, ``(sample, field, *grid)``: thresholds of gates lie among them.
    """
    system = objective.forward_model.simulator.system
    candidates = objective.forward_model.law.candidates
    pieces = list(pieces_of(system, candidates, windowed, objective.forward_model.times, states))
    columns = [
        *candidates,
        *(restrict_to_window([candidates[p.candidate]], p.window)[0] for p in pieces),
    ]
    stds = torch.cat([objective.prior_std, *[objective.prior_std[[p.candidate]] for p in pieces]])
    problem = profile_out(objective, forced, columns, stds)
    found = [_screened(problem, Hypothesis((j,)), {j: 1.0}) for j in range(global_count)]
    pairs = [(i, j) for j in range(global_count) for i in range(j)]
    costs = problem.costs(pairs).tolist() if pairs else []
    for pair, cost in zip(pairs, costs, strict=True):
        coefficients = tuple(problem.coefficients(pair).tolist())
        found.append(Screened(Hypothesis(pair), cost, coefficients))
    for j, guess, weights in windows_of(problem, system, pieces, len(candidates)):
        found.append(_screened(problem, Hypothesis((), (j,), guess), weights))
    return found


def profile_out(
    objective: LeastSquaresProblem, forced: FreeForcing, columns: Sequence[Candidate], stds: Tensor
) -> ProfiledProblem:
    """Linearise about the forced trajectory, and take out the forcing and the law under it.

    Args:
        objective: F of a law.
        forced: a forcing that explains the recording, on top of a law or of none.
        columns: candidates, in a window or not.
        stds: prior std of each one's coefficient.
    """
    driven, places = forced.objective.forward_model, forced.objective.forward_model.slices
    z, xi = forced.objective.split(forced.phi)
    carrier = driven.law.terms(xi[places.law])
    # A term in a window goes by the name of the plain one: only tangents tell them apart.
    [readings] = driven.readings(z[None], xi[None])
    law = LawBlock((*columns, *carrier))
    forward_model = replace(objective.forward_model, law=law, forcing=driven.forcing)
    # The edges of the carrier's window stay where they are.
    borne = [*range(len(carrier)), *range(len(xi))[places.forcing]]
    priors = torch.cat([stds, forced.objective.prior_std[borne]])
    whole = replace(objective, forward_model=forward_model, prior_std=priors)
    zero = torch.zeros(len(columns), dtype=torch.float64)
    normal = whole.linearise(torch.cat([z, zero, xi[borne]]), readings)
    target = normal.target
    kept = objective.modes + len(columns)
    # F(φ) ≈ ‖J φ - b‖²: without the carrier's columns the law that is asked has to bear b.
    without = replace(
        normal,
        jacobian=normal.jacobian[:, :kept],
        precision=normal.precision[:kept],
        phi=torch.zeros(kept, dtype=torch.float64),
        residuals=-target,
    )
    return ProfiledProblem.from_normal_equations(without, objective.modes)


def _screened(
    problem: ProfiledProblem, hypothesis: Hypothesis, weights: dict[int, float]
) -> Screened:
    """Return the best coefficient of one sum of columns."""
    index = list(weights)
    w = torch.tensor([weights[j] for j in index], dtype=torch.float64)
    gram = float(w @ problem.gram[index][:, index] @ w)
    goal = float(w @ problem.target[index])
    precision = float(problem.precision[index[0]])
    return Screened(
        hypothesis, problem.constant - goal**2 / (gram + precision), (goal / (gram + precision),)
    )
