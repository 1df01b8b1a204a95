"""A window that is fitted from elsewhere: a fit ends in the nearest of several minima.

Where few states lie, F is flat in a gate's threshold, and it is steep where that cuts into one that
is dwelt in. And a narrow box with a large coefficient does nearly what a wide one with a small one
does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import Fitted, minimise
from dashred.inference.forward.law_block import WindowedTerms
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, replace_minimum

# Windows whose score is no farther than this from the best may yet be the best; of so many.
SCORE_MARGIN, MAX_RESTARTED = 20.0, 4
# Thresholds that are tried, evenly between these quantiles of the field; one that is closer to the
# fitted one than this share of their range leads there again.
THRESHOLDS, TAIL, MIN_DISTANCE = 4, 0.02, 0.1
# Widths of a box, in those of the fitted one; a share of the axis beyond which it is no region.
WIDTH_FACTORS, MAX_LENGTH = (0.5, 2.0), 0.75
FIRST_STEPS, FIRST_TOLERANCE = 3, 1e-2
LAST_STEPS, LAST_TOLERANCE = 10, 1e-4


@dataclass(frozen=True)
class Restart:
    """Where a window is looked for.

    Attributes:
        edges: ψ, ``(unknown,)``.
        factor: of its coefficients, by which they begin to do about as much as before.
    """

    edges: Tensor
    factor: float


def restart_windows(fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """Return what boxes and gates that are nearly the best become from elsewhere, if better.

    Args:
        found: explanations, the best first.
    """
    close = (fit for fit in fits if fit.law.score < fits[0].law.score + SCORE_MARGIN)
    near = ((fit, restarts) for fit in close if (restarts := _build_restarts(fit)))
    trials = (_restart(fit, restarts) for fit, restarts in islice(near, MAX_RESTARTED))
    return [better for better in trials if better is not None]


def _restart(fit: HypothesisFit, restarts: Sequence[Restart]) -> HypothesisFit | None:
    """Return a window at a lower minimum; None where none is found."""
    [cost], _ = fit.objective.values(fit.phi[None])
    trials = [_fit_restart(fit, restart) for restart in restarts]
    objective, first = min(trials, key=lambda pair: pair[1].cost)
    if first.cost > float(cost) + SCORE_MARGIN:
        return None
    last = minimise(objective, first.phi, LAST_STEPS, LAST_TOLERANCE)
    return replace_minimum(fit, objective, last) if last.cost < float(cost) else None


def _build_restarts(fit: HypothesisFit) -> list[Restart]:
    """Return where else the window of a law may be; nowhere, if it has none of these kinds."""
    windowed = fit.objective.forward_model.law.windowed
    if windowed is None:
        return []
    window = windowed.window(fit.phi[-windowed.count :])
    edges = torch.tensor(window.values).double()
    if windowed.shape.kind == "box":
        return _box_restarts(fit, windowed, edges)
    return _gate_restarts(fit, windowed, edges) if windowed.shape.kind.startswith("gate") else []


def _box_restarts(fit: HypothesisFit, windowed: WindowedTerms, edges: Tensor) -> list[Restart]:
    """Return boxes of other widths about the same place."""
    axes = {axis.name: axis for axis in fit.objective.forward_model.simulator.system.axes}
    most = MAX_LENGTH * axes[windowed.shape.of].length / 2
    place, half, rest = edges[:1], edges[1:2], edges[2:]
    wider = [width for width in WIDTH_FACTORS if width * float(half) < most]
    return [Restart(torch.cat([place, width * half, rest]), 1 / width) for width in wider]


def _gate_restarts(fit: HypothesisFit, windowed: WindowedTerms, edges: Tensor) -> list[Restart]:
    """Return gates at thresholds among the states of the law's own trajectory."""
    objective, forward_model = fit.objective, fit.objective.forward_model
    states = forward_model.sampled_states(*objective.split(fit.phi))
    field = forward_model.simulator.system.fields.index(windowed.shape.of)
    values = states[:, field].flatten()
    low, high = (float(values.quantile(share)) for share in (TAIL, 1 - TAIL))
    places = torch.linspace(low, high, THRESHOLDS + 2, dtype=torch.float64)[1:-1]
    apart = (places - edges[0]).abs() > MIN_DISTANCE * (high - low)
    # How sharp the gate was guessed to be tells more than a fit that ended elsewhere.
    return [Restart(torch.cat([at[None], windowed.guess[1:]]), 1.0) for at in places[apart]]


def _fit_restart(fit: HypothesisFit, restart: Restart) -> tuple[LeastSquaresProblem, Fitted]:
    """Give a window a few steps from elsewhere."""
    objective = move_window(fit.objective, restart.edges)
    phi, edges = fit.phi.clone(), len(fit.phi) - len(restart.edges)
    phi[edges:] = 0.0
    phi[objective.modes + len(objective.forward_model.law.candidates) : edges] *= restart.factor
    return objective, minimise(objective, phi, FIRST_STEPS, FIRST_TOLERANCE)


def move_window(objective: LeastSquaresProblem, guess: Tensor) -> LeastSquaresProblem:
    """Return F of a law in a window, the first guess of that elsewhere, ``(edge,)``."""
    forward_model, windowed = objective.forward_model, objective.forward_model.law.windowed
    moved = windowed and replace(windowed, guess=guess)
    law = replace(forward_model.law, windowed=moved)
    return replace(objective, forward_model=replace(forward_model, law=law))
