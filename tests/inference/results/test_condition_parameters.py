"""A parameter of a condition at an end changes its value; no term is added to an equation."""

from __future__ import annotations

import pytest

from dashred.inference.results.corrected_system import build_corrected_system
from tests import laws

TEXT = """
system:
  title: a rod, heated at one end
  axes: {x: {length: 1, points: 8, ends: {left: {flux: q}, right: {value: 0}}}}
  fields: {T: temperature}
  parameters: {k: 0.5, q: 2}
  equations: {T: "k*d(T, x, 2)"}
  start: {T: 0}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""


@pytest.mark.parametrize("name", ["q", "k", "T_left_offset", "T_right_offset"])
def test_a_change_is_a_value_of_the_parameter(tmp_path, name):
    system = laws.declared(tmp_path, TEXT)
    corrected = build_corrected_system(system, laws.law([laws.parameter(system, name)], [0.1]))
    stated = system.config.parameters[name]
    assert corrected.config.parameters[name] == pytest.approx(stated + 0.1)
    assert corrected.config.equations == system.config.equations
