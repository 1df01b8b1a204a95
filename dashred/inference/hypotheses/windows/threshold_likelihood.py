"""Profile likelihood of a gate's threshold, which gives its confidence interval.

If a system jumps between two states, few samples lie between them. F is then flat between the
states and steep where the gate begins to cut into either of them. The curvature of F at one point
does not give the width of this valley.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from dashred.core.formatting import Z95
from dashred.inference.fit.law import Law
from dashred.inference.fit.levenberg_marquardt import chord_refits
from dashred.inference.forward.law_block import WindowedTerms
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit

# Number of thresholds on either side. They reach from this share of the standard deviation by
# curvature to the farthest state of the trajectory.
THRESHOLDS_PER_SIDE, NEAREST_SHARE = 16, 0.5
STEPS, TOLERANCE, MAX_RISE = 6, 0.1, 200.0
# Rise of F at the ends of a 95 % interval.
RISE = Z95**2


def profile_threshold(fit: HypothesisFit) -> Law:
    """Return the law of a fit, with the profile interval of the threshold if it has a gate."""
    window, windowed = fit.law.window, fit.objective.forward_model.law.windowed
    if window is None or windowed is None or not window.shape.kind.startswith("gate"):
        return fit.law
    low, high = _interval(fit, windowed)
    threshold = window.values[0]
    std = max(high - threshold, threshold - low) / Z95
    edges = (max(std, fit.law.edges[0]), *fit.law.edges[1:])
    return replace(fit.law, edges=edges, threshold=(low, high))


def _interval(fit: HypothesisFit, windowed: WindowedTerms) -> tuple[float, float]:
    """Return the interval in which F, minimised over all else, rises by less than ``RISE``."""
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
    refits = chord_refits(objective, fit.normal, begin, is_free, STEPS, TOLERANCE, MAX_RISE)
    [cost], _ = objective.values(phi[None])
    rises = (refits.cost - cost).split(THRESHOLDS_PER_SIDE)
    ends = [_crossing(at, side, rise) for side, rise in zip(sides, rises, strict=True)]
    return threshold + min(ends), threshold + max(ends)


def _steps(nearest: float, farthest: float) -> Tensor:
    """Return logarithmically spaced distances, ``(threshold,)``."""
    ends = torch.tensor([nearest, max(farthest, 2 * nearest)], dtype=torch.float64).log()
    return torch.linspace(
        float(ends[0]), float(ends[1]), THRESHOLDS_PER_SIDE, dtype=torch.float64
    ).exp()


def _crossing(at: float, places: Tensor, rises: Tensor) -> float:
    """Return the place beyond which F exceeds ``RISE``, interpolated between two places.

    The interpolation takes F to be a parabola.
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
