"""Segments follow the simulator, and their sensitivities are its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from tests.inference.segments.conftest import Convection


def test_segments_of_a_trajectory_lie_on_it(convection: Convection) -> None:
    segments, simulator = convection.segments, convection.simulator
    damping = [convection.candidates[convection.index("y: y")]]
    nodes = convection.states[::4][: segments.count]
    states = simulator.with_substeps(16).run(nodes, damping, np.array([-1.0]))
    np.testing.assert_allclose(segments.join(states, 0), convection.states, atol=2e-4)


def test_the_error_falls_with_the_fourth_order(convection: Convection) -> None:
    segments, simulator = convection.segments, convection.simulator
    damping = [convection.candidates[convection.index("y: y")]]
    nodes = convection.states[::4][: segments.count]
    errors = [
        np.abs(
            segments.join(simulator.with_substeps(n).run(nodes, damping, np.array([-1.0])), 0)
            - convection.states
        ).max()
        for n in (8, 16)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.5)


def test_sensitivities_are_central_differences(convection: Convection) -> None:
    simulator, candidates = convection.simulator, convection.candidates
    rng = np.random.default_rng(2)
    nodes = convection.states[::4][: simulator.segments.count]
    xi = 0.01 * rng.standard_normal(len(candidates))
    states, columns = simulator.linearise(nodes, candidates, xi)
    np.testing.assert_allclose(states, simulator.run(nodes, candidates, xi))
    step = 1e-6
    for direction in rng.standard_normal((3, 3 + len(xi))):
        moved = [
            simulator.run(nodes + s * direction[:3], candidates, xi + s * direction[3:])
            for s in (step, -step)
        ]
        expected = (moved[0] - moved[1]) / (2 * step)
        np.testing.assert_allclose(columns @ direction, expected, rtol=1e-5, atol=1e-5)
