"""Whether the equations are affine in some parameters together."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.physics.parameter_sensitivity import act_separately, acts_linearly
from tests import laws

TEXT = """
system:
  title: a mass on a spring
  fields: {q: place, p: momentum}
  parameters: {m: 2, w: 0.5, k: 3, b: 0.1, depth: 4, rate: 0.5, edge: 2}
  let: {speed: w*p}
  equations:
    q: speed
    p: -k*q/m - b*speed - depth**2*q + exp(rate*q) + clip(q, -edge, edge)
  start: {q: 1, p: 0}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ((), True),
        (("k",), True),
        (("k", "b"), True),
        (("w",), True),
        # Each acts linearly alone.
        (("b", "w"), False),
        (("m",), False),
        (("depth",), False),
        (("k", "rate"), False),
        # Its tangent is the same on both sides of the edge.
        (("edge",), False),
    ],
)
def test_acts_linearly(tmp_path: Path, parameters: tuple[str, ...], expected: bool) -> None:
    assert acts_linearly(laws.declared(tmp_path, TEXT), parameters) == expected


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        (("m",), True),
        (("b", "depth"), True),
        (("b", "w"), False),
        (("k", "m"), False),
    ],
)
def test_act_separately(tmp_path: Path, parameters: tuple[str, ...], expected: bool) -> None:
    assert act_separately(laws.declared(tmp_path, TEXT), parameters) == expected
