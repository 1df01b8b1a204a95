"""Steps of segments end where a held input jumps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dashred.data.inputs import with_inputs
from dashred.inference.segments.segments import cut
from dashred.inference.segments.steps.divided_intervals import divided
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.physics.backends.input_signals import InputSignals
from tests import laws

TIMES = np.arange(9.0)
# The first interval of a segment has two jumps, some have one, and some have none.
JUMPS = np.array([0.0, 0.3, 0.7, 2.0, 3.6, 6.25, 8.0])
LEVELS = np.array([1.0, 3.0, 0.0, 2.0, -1.0, 4.0, 4.0])
TEXT = """
system:
  title: a level with a pump
  fields: {u: level}
  inputs: {e: {column: pump, hold: true}}
  equations: {u: e - u}
  start: {u: 0}
  spread: {u: 1}
  integrator: {method: rk4, dt: 0.5}
recording: {twin: a, sensors: 1, noise: 0, duration: 8, every: 1}
"""


def exact(t: float) -> float:
    """Return the level at a time, from 0 at the first."""
    u = 0.0
    for begin, end, level in zip(JUMPS[:-1], JUMPS[1:], LEVELS[:-1], strict=True):
        u = level + (u - level) * np.exp(-max(0.0, min(end, t) - begin))
    return u


def test_a_jump_between_samples_costs_no_order(tmp_path: Path) -> None:
    system = with_inputs(laws.declared(tmp_path, TEXT), InputSignals(JUMPS, {"pump": LEVELS}))
    levels = np.array([exact(t) for t in TIMES])
    segments = cut([TIMES], [levels[:, None]])
    nodes, errors = levels[::4][: segments.count, None], []
    for parts in (4, 16):
        states = SegmentSimulator([system], segments, parts).run(nodes, (), np.zeros(0))
        errors.append(np.abs(segments.join(states, 0)[:, 0] - levels).max())
    assert errors[0] < 1e-4
    assert errors[0] / errors[1] > 40


def test_steps_are_equal_without_jumps_and_end_at_each_jump() -> None:
    segments = cut([TIMES], [TIMES[:, None]])
    begins, lengths = divided(segments, 3, [np.array([2.0, 4.0])])
    assert begins.shape == lengths.shape == (12, segments.count)
    np.testing.assert_allclose(lengths, 1 / 3)
    begins, lengths = divided(segments, 3, [JUMPS])
    for jump in (0.3, 0.7, 3.6, 6.25):
        assert np.abs(begins - jump).min() == pytest.approx(0.0, abs=1e-12)
    assert lengths.max() <= 1 / 3 + 1e-12
    np.testing.assert_allclose(begins[1:], (begins + lengths)[:-1])
