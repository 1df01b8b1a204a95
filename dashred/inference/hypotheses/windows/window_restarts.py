"""Restarts of windows from other first guesses, because a fit ends in the nearest minimum.

F is flat in a gate's threshold where there are few states, and steep where the threshold cuts into
frequent states. A narrow box with a large coefficient acts nearly like a wide box with a small one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import torch
from torch import Tensor

from dashred.core.budget import in_time
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.forward.law_block import WindowedTerms
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, replace_minimum

# Windows within this score difference of the best are restarted, and at most this many.
SCORE_MARGIN, MAX_RESTARTED = 20.0, 4
# Number of thresholds, evenly spaced between two quantiles of the field. One is dropped if it is
# closer to the fitted threshold than this share of their range.
THRESHOLDS, TAIL, MIN_DISTANCE = 4, 0.02, 0.1
# Widths of a box, relative to the fitted width, and the largest length as a share of the axis.
WIDTH_FACTORS, MAX_LENGTH = (0.5, 2.0), 0.75
FIRST_STEPS, FIRST_TOLERANCE = 3, 1e-2
LAST_STEPS, LAST_TOLERANCE = 10, 1e-4


@dataclass(frozen=True)
class Restart:
    """Another first guess of a window.

    Attributes:
        edges: ψ, ``(edge,)``.
        factor: factor of its coefficients, which keeps their effect about the same.
    """

    edges: Tensor
    factor: float


def restart_windows(fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """Refit nearly best boxes and gates from other first guesses; return those that improve.

    Args:
        fits: hypotheses, the best first.
    """
    close = (fit for fit in fits if fit.law.score < fits[0].law.score + SCORE_MARGIN)
    restartable = ((fit, restarts) for fit in close if (restarts := _build_restarts(fit)))
    refits = in_time(lambda pair: _restart(*pair), islice(restartable, MAX_RESTARTED))
    return [fit for fit in refits if fit is not None]


def _restart(fit: HypothesisFit, restarts: Sequence[Restart]) -> HypothesisFit | None:
    """Return the fit at a lower minimum; None if none is found."""
    [cost], _ = fit.objective.values(fit.phi[None])
    trials = [_fit_restart(fit, restart) for restart in restarts]
    objective, first = min(trials, key=lambda pair: pair[1].cost)
    if first.cost > float(cost) + SCORE_MARGIN:
        return None
    last = minimise(objective, first.phi, LAST_STEPS, LAST_TOLERANCE)
    return replace_minimum(fit, objective, last) if last.cost < float(cost) else None


def _build_restarts(fit: HypothesisFit) -> list[Restart]:
    """Return other first guesses of a box or gate; none for other laws."""
    windowed = fit.objective.forward_model.law.windowed
    if windowed is None:
        return []
    window = windowed.window(fit.phi[-windowed.count :])
    edges = torch.tensor(window.values).double()
    if windowed.shape.kind == "box":
        return _box_restarts(fit, windowed, edges)
    return _gate_restarts(fit, windowed, edges) if windowed.shape.kind.startswith("gate") else []


def _box_restarts(fit: HypothesisFit, windowed: WindowedTerms, edges: Tensor) -> list[Restart]:
    """Return boxes of other widths at the same place."""
    axes = {axis.name: axis for axis in fit.objective.forward_model.simulator.system.axes}
    max_half = MAX_LENGTH * axes[windowed.shape.of].length / 2
    place, half, rest = edges[:1], edges[1:2], edges[2:]
    factors = [factor for factor in WIDTH_FACTORS if factor * float(half) < max_half]
    return [Restart(torch.cat([place, factor * half, rest]), 1 / factor) for factor in factors]


def _gate_restarts(fit: HypothesisFit, windowed: WindowedTerms, edges: Tensor) -> list[Restart]:
    """Return gates at thresholds among the states of the law's own trajectory."""
    objective, forward_model = fit.objective, fit.objective.forward_model
    states = forward_model.sampled_states(*objective.split(fit.phi))
    field = forward_model.simulator.system.fields.index(windowed.shape.of)
    values = states[:, field].flatten()
    low, high = (float(values.quantile(share)) for share in (TAIL, 1 - TAIL))
    places = torch.linspace(low, high, THRESHOLDS + 2, dtype=torch.float64)[1:-1]
    is_far = (places - edges[0]).abs() > MIN_DISTANCE * (high - low)
    # The guessed width of the edge is more reliable than that of a fit in another minimum.
    return [Restart(torch.cat([at[None], windowed.guess[1:]]), 1.0) for at in places[is_far]]


def _fit_restart(fit: HypothesisFit, restart: Restart) -> tuple[LeastSquaresProblem, FitResult]:
    """Fit a window for a few steps from another first guess."""
    objective = move_window(fit.objective, restart.edges)
    phi, edges = fit.phi.clone(), len(fit.phi) - len(restart.edges)
    phi[edges:] = 0.0
    phi[objective.modes + len(objective.forward_model.law.candidates) : edges] *= restart.factor
    return objective, minimise(objective, phi, FIRST_STEPS, FIRST_TOLERANCE)


def move_window(objective: LeastSquaresProblem, guess: Tensor) -> LeastSquaresProblem:
    """Return F of a law in a window with another first guess, ``(edge,)``."""
    forward_model, windowed = objective.forward_model, objective.forward_model.law.windowed
    moved = windowed and replace(windowed, guess=guess)
    law = replace(forward_model.law, windowed=moved)
    return replace(objective, forward_model=replace(forward_model, law=law))
