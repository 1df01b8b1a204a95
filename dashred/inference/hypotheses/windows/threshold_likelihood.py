"""How surely a gate's threshold is known: by a profile of F, which a curvature cannot tell.

Between two states that a system jumps between few samples lie: F is flat there, and steep where a
gate begins to cut into either state. Its curvature at one point says nothing of that width.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from dashred.inference.fit.law import Z95, Law
from dashred.inference.fit.levenberg_marquardt import chord_refits
from dashred.inference.forward.law_block import WindowedTerms
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit

# Thresholds that are tried on either side: from a share of the std that the curvature gives, to the
# farthest state of the trajectory.
THRESHOLDS_PER_SIDE, NEAREST_SHARE = 16, 0.5
STEPS, TOLERANCE, MAX_RISE = 6, 0.1, 200.0
# F rises by this to the ends of a 95 % interval.
RISE = Z95**2


def profile_threshold(fit: HypothesisFit) -> Law:
    """Return the law of a fit, a gate's threshold with the interval that its profile gives."""
    window, windowed = fit.law.window, fit.objective.forward_model.law.windowed
    if window is None or windowed is None or not window.shape.kind.startswith("gate"):
        return fit.law
    low, high = _interval(fit, windowed)
    threshold = window.values[0]
    std = max(high - threshold, threshold - low) / Z95
    edges = (max(std, fit.law.edges[0]), *fit.law.edges[1:])
    return replace(fit.law, edges=edges, threshold=(low, high))


def _interval(fit: HypothesisFit, windowed: WindowedTerms) -> tuple[float, float]:
    """Return between which thresholds F, at its lowest in all else, rises by less than ``RISE``."""
    objective, phi = fit.objective, fit.phi
    forward_model, threshold = objective.forward_model, float(windowed.guess[0])
    place = len(phi) - len(windowed.guess)
    at = float(phi[place])
    states = forward_model.sampled_states(*objective.split(phi))
    field = forward_model.simulator.system.fields.index(windowed.shape.of)
    values = states[:, field] - threshold
    nearest = NEAREST_SHARE * fit.law.edges[0]
    sides = [
        at + sign * _steps(nearest, sign * (float(end) - at))
        for sign, end in ((-1.0, values.min()), (1.0, values.max()))
    ]
    thresholds = torch.cat(sides)
    begin = phi.expand(len(thresholds), -1).clone()
    begin[:, place] = thresholds
    is_free = torch.ones(begin.shape, dtype=torch.bool)
    is_free[:, place] = False
    found = chord_refits(objective, fit.normal, begin, is_free, STEPS, TOLERANCE, MAX_RISE)
    [cost], _ = objective.values(phi[None])
    rises = (found.cost - cost).split(THRESHOLDS_PER_SIDE)
    ends = [_crossing(at, side, rise) for side, rise in zip(sides, rises, strict=True)]
    return threshold + min(ends), threshold + max(ends)


def _steps(nearest: float, farthest: float) -> Tensor:
    """Return distances that grow evenly in their logarithm, ``(tried,)``."""
    ends = torch.tensor([nearest, max(farthest, 2 * nearest)], dtype=torch.float64).log()
    return torch.linspace(
        float(ends[0]), float(ends[1]), THRESHOLDS_PER_SIDE, dtype=torch.float64
    ).exp()


def _crossing(at: float, places: Tensor, rises: Tensor) -> float:
    """Return where F has risen enough for good: beyond the farthest place where it has not.

    Between two places F rises as a parabola does.
    """
    below = torch.nonzero(rises < RISE).flatten()
    last = int(below[-1]) if len(below) else -1
    if last + 1 == len(places):
        return float(places[-1])
    inner = at if last < 0 else float(places[last])
    before = 0.0 if last < 0 else math.sqrt(max(float(rises[last]), 0.0))
    after = math.sqrt(float(rises[last + 1]))
    share = (Z95 - before) / (after - before) if math.isfinite(after) else 1.0
    return inner + share * (float(places[last + 1]) - inner)
