"""The windows that are screened are those that the simulator knows."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dashred.inference.forward.candidates import build_candidates
from dashred.inference.hypotheses.windows.window_columns import build_pieces
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.terms.library import build_library
from dashred.physics.window import window_shapes
from tests import laws

TEXT = """
system:
  title: string
  axes: {x: {length: 2, points: 16, ends: ENDS}}
  fields: {w: deflection, p: momentum}
  equations: {w: p, p: lap(w)}
  start: {w: 0.3*sin(pi*x/2), p: 0.1*sin(pi*x)}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""


@pytest.mark.parametrize("ends", ["periodic", "fixed", "insulated"])
def test_every_screened_window_has_a_shape_of_the_system(tmp_path: Path, ends: str) -> None:
    """A field between fixed ends has its mirror image beyond them."""
    system = laws.declared(tmp_path, TEXT.replace("ENDS", ends))
    times = torch.linspace(0, 4, 21, dtype=torch.float64)
    [states] = simulate(system, nominal_start(system), times)
    library = build_library(system, {"p": ["p", "w"]})
    candidates = build_candidates(system, library, states, 0.0)
    pieces = list(build_pieces(system, candidates, [0, 1], times, states))
    screened = {piece.window.shape.expression for piece in pieces}
    assert len(screened) == 4  # along x, in time, above a value of w and of p
    assert screened <= {shape.expression for shape in window_shapes(system)}
