"""A gate's threshold, fitted from elsewhere: a fit ends in the nearest of several minima.

Where few states lie F is flat, and it is steep where the threshold cuts into one that is dwelt in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from dashred.discovery.cause import Cause, ended
from dashred.discovery.gauss_newton import Fitted, minimise
from dashred.discovery.local_shooting import LocalShooting
from dashred.discovery.objective import Objective

# Gates whose score is no farther than this from the best may yet be the best; of so many.
NEAR, MOST = 20.0, 4
# Thresholds that are tried, evenly between these quantiles of the field; one that is closer to the
# fitted one than this share of their range leads there again.
TRIED, TAIL, CLOSE = 4, 0.02, 0.1
FIRST_STEPS, FIRST_TOLERANCE = 3, 1e-2
LAST_STEPS, LAST_TOLERANCE = 10, 1e-4


def from_other_thresholds(found: Sequence[Cause]) -> list[Cause]:
    """Return what gates that are nearly the best become from other thresholds, if that is better.

    Args:
        found: explanations, the best first.
    """
    near = [c for c in found if c.law.score < found[0].law.score + NEAR and _is_gate(c)]
    return [better for cause in near[:MOST] if (better := _better(cause)) is not None]


def _is_gate(cause: Cause) -> bool:
    shooting = cause.objective.shooting
    return isinstance(shooting, LocalShooting) and shooting.shape.kind.startswith("gate")


def _better(cause: Cause) -> Cause | None:
    """Return a gate with its threshold at a lower minimum; None where none is found."""
    [cost], _ = cause.objective.values(cause.phi[None])
    tried = [_fit(cause, place) for place in _places(cause)]
    if not tried:
        return None
    objective, first = min(tried, key=lambda pair: pair[1].cost)
    if first.cost > float(cost) + NEAR:
        return None
    last = minimise(objective, first.phi, LAST_STEPS, LAST_TOLERANCE)
    return ended(cause, objective, last) if last.cost < float(cost) else None


def _places(cause: Cause) -> Tensor:
    """Return thresholds among the states of the law's own trajectory, ``(tried,)``."""
    objective, shooting = cause.objective, cause.objective.shooting
    assert isinstance(shooting, LocalShooting)
    states = shooting.visited(*objective.split(cause.phi))
    field = shooting.simulator.system.fields.index(shooting.shape.of)
    values = states[:, field].flatten()
    low, high = (float(values.quantile(share)) for share in (TAIL, 1 - TAIL))
    places = torch.linspace(low, high, TRIED + 2, dtype=torch.float64)[1:-1]
    threshold = float(shooting.window(objective.split(cause.phi)[1]).values[0])
    return places[(places - threshold).abs() > CLOSE * (high - low)]


def _fit(cause: Cause, place: Tensor) -> tuple[Objective, Fitted]:
    """Give a gate a few steps from a threshold."""
    shooting = cause.objective.shooting
    assert isinstance(shooting, LocalShooting)
    guess = torch.cat([place[None], shooting.guess[1:]])
    objective = replace(cause.objective, shooting=replace(shooting, guess=guess))
    begin = cause.phi.clone()
    begin[len(begin) - len(guess) :] = 0.0
    return objective, minimise(objective, begin, FIRST_STEPS, FIRST_TOLERANCE)
