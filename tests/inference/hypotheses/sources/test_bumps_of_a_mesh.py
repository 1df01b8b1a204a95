"""Bumps about the cells of a mesh are narrow enough for a source, also in a long channel."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.inference.hypotheses.free_forcing import CELLS
from dashred.inference.hypotheses.sources.screening import _bumps, widest_bump
from dashred.physics.forcing_basis import square_mesh
from tests import laws

TEXT = """
system:
  title: a channel
  axes: {{x: {{length: {length}, points: 16}}, y: {{length: 1, points: 8, ends: insulated}}}}
  fields: {{c: concentration}}
  equations: {{c: 0.1*lap(c)}}
  start: {{c: 1}}
  integrator: {{dt: 0.1}}
recording: {{twin: a, sensors: 4, noise: 0, duration: 1, every: 0.1}}
"""


@pytest.mark.parametrize(("length", "widest", "narrowest"), [(1, 0.2, 0.125), (4, 0.4, 0.25)])
def test_bumps_lie_in_the_domain(
    tmp_path: Path, length: int, widest: float, narrowest: float
) -> None:
    system = laws.declared(tmp_path, TEXT.format(length=length))
    assert widest_bump(system) == pytest.approx(widest)
    mesh = square_mesh([axis.length for axis in system.axes], CELLS[2])
    bumps = list(_bumps(system, mesh))
    widths = {bump.width for bump in bumps}
    assert min(widths) == pytest.approx(narrowest) and max(widths) <= widest
    assert all(0 < x < length and 0 < y < 1 for x, y in (bump.centre for bump in bumps))
