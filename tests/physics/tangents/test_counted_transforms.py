"""The Fourier transforms of trajectories and columns against counts by hand.

A change that needs more transforms shows here on any machine.
"""

from __future__ import annotations

import pytest
import torch

from dashred.core.work import TRANSFORM_VALUES, TRANSFORMS, work_done
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import System, Term
from dashred.physics.tangents.compiled_trajectory import CompiledTrajectory
from dashred.physics.tangents.tangent_linear import tangent_linear
from dashred.physics.terms.library import resolve

POINTS = 12 * 16
FRONT = """
    axes: {x: {length: 2*pi, points: 12}, y: {length: 2*pi, points: 16}}
    fields: {u: height}
    equations: {u: -grad2(u)/2 - 0.1*lap(u) - 0.01*lap(lap(u))}
    start: {u: 0.1*sin(x)*cos(y)}
    integrator: {dt: 0.1}
"""
# Two samples after the first, with three steps each.
TIMES = torch.tensor([0.0, 0.3, 0.6], dtype=torch.float64)
SAMPLES, STEPS, STAGES = 2, 6, 4


@pytest.fixture
def front(make_system) -> System:
    return make_system(FRONT)


@pytest.fixture
def terms(front: System) -> tuple[Term, ...]:
    """Two terms: u², which is transformed once a stage, and one without a product."""
    texts = ("u**2", "d(u, x)")
    return resolve(front, [Term("u", front.parse(text, "test", equation="u")) for text in texts])


def test_trajectories(front: System, terms: tuple[Term, ...]) -> None:
    compiled = CompiledETDRK4(front, terms)
    weights = torch.tensor([[0.0, 0.1], [0.1, 0.0], [0.1, 0.1]], dtype=torch.float64)
    before = work_done()
    compiled(nominal_start(front).expand(3, -1, -1, -1), TIMES, weights)
    # Each stage: u and its two derivatives to the grid, and one channel back, which u² shares.
    # Each sample: the state to modes and back.
    added = (3 * STEPS * STAGES * (3 + 1)) + 3 * SAMPLES * 2
    assert _added(before) == (added, added * POINTS)


def test_columns(front: System, terms: tuple[Term, ...]) -> None:
    weights = torch.zeros((1, 2), dtype=torch.float64)
    trajectory = CompiledTrajectory(CompiledETDRK4(front, terms), weights, None)
    start = nominal_start(front)[0]
    directions = torch.stack([start, 2 * start, 3 * start])
    before = work_done()
    sources = [(term,) for term in terms]
    law = Forcing((), torch.zeros((1, 0), dtype=torch.float64))
    columns = [*tangent_linear(front, start, directions, TIMES, law, sources, reference=trajectory)]
    assert len(columns) == 1 + SAMPLES and columns[0][1].shape[0] == 5
    trajectory_made = STEPS * STAGES * (3 + 1) + SAMPLES * 3 + 1
    # Each stage: the derivatives of u to the grid for the slopes, u for the source, and u² back.
    stages_made = STEPS * STAGES * (2 + 1 + 1)
    # The five columns are three pairs; a pair counts as two. Each stage: the derivatives of the
    # column to the grid, and one channel back. Each sample: to the grid. At the start: to modes.
    columns_made = 6 * (STEPS * STAGES * (2 + 1) + SAMPLES + 1)
    made = trajectory_made + stages_made + columns_made
    assert _added(before) == (made, made * POINTS)


def _added(before: dict[str, int]) -> tuple[int, int]:
    """Return the transforms and their values since an earlier count."""
    now = work_done()
    kinds = TRANSFORMS, TRANSFORM_VALUES
    transforms, values = (now.get(kind, 0) - before.get(kind, 0) for kind in kinds)
    return transforms, values
