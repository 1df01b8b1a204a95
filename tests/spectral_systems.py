"""Two spectral systems and a clock, on which ways to compute tangents are compared."""

from __future__ import annotations

import torch

# Intervals of different lengths, so that steps of several lengths stand in one block.
TIMES = torch.tensor([0.5, 0.6, 0.93, 1.0, 1.7]).double()
REACTION = """
    axes: {x: {length: 2*pi, points: 32}}
    fields: {u: energy, v: progress}
    equations:
      u: -d(u**2/2, x) + v*exp(u) - 0.9*u**2 + 0.1*lap(u) + 0.1*sin(x - t)*u
      v: 0.2*(1 - v) - v*u**2 + 0.1*lap(v) + 0.05*d(u + v, x)
    start: {u: 0.6 + 0.3*sin(x), v: 0.7 + 0.1*cos(2*x)}
    integrator: {dt: 0.02, dealias: true}
"""
PLANE = """
    axes: {x: {length: 2*pi, points: 16}, y: {length: 4*pi, points: 12}}
    fields: {w: vorticity}
    equations:
      w: d(inv_lap(w), y)*d(w, x) - d(inv_lap(w), x)*d(w, y) + 0.1*lap(w) + cos(2*x)
    start: {w: cos(x)*sin(y/2) + 0.3*sin(x)}
    integrator: {dt: 0.05}
"""
