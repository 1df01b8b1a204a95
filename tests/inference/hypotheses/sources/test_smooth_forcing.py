"""A smooth forcing on a fine mesh: it follows the coarse one, and its maximum is at the source."""

from __future__ import annotations

import pytest
import torch

from dashred.inference.hypotheses.forcing_levels import evidence
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_free_forcing
from dashred.inference.hypotheses.sources.bump import Bump
from dashred.inference.hypotheses.sources.smooth_forcing import (
    LinearisedForcing,
    build_smooth_map,
    fit_smooth_forcing,
    linearise_fine_forcing,
)
from tests.channel import Channel, fitted

PLACE = 4.1


@pytest.fixture(scope="module")
def forcing(channel: Channel) -> FreeForcing:
    """A coarse forcing that explains a steady source."""
    hidden = [(Bump((PLACE,), 0.4).text(channel.system), 0.3)]
    null = channel.objective(channel.recorded(hidden))
    return fit_free_forcing(null, fitted(null), channel.size)[0]


def test_the_fine_mesh_has_the_trajectory_of_the_coarse_one(forcing: FreeForcing) -> None:
    fine = linearise_fine_forcing(forcing)
    fields, cells, knots = fine.block.basis.shape
    assert fields == 1 and cells > forcing.block.basis.shape[1] and knots > 13
    difference = fine.normal.residuals - forcing.normal.residuals
    assert float(difference.square().mean().sqrt()) < 1.0


def test_the_map_of_a_smooth_forcing(forcing: FreeForcing) -> None:
    smooth = fit_smooth_forcing(linearise_fine_forcing(forcing), forcing.levels)
    residuals = smooth.forcing.normal.residuals
    assert float(residuals.square().mean()) < 1.2
    everything = range(len(smooth.forcing.phi))
    assert evidence(smooth.forcing.normal, everything) < forcing.evidence + 10
    found = build_smooth_map(smooth, 100.0)
    assert abs(found.peak[0] - PLACE) < 0.7
    assert found.amplitudes.shape == found.stds.shape == (1, len(found.places), len(found.times))
    assert (found.stds > 0).all()


def test_without_its_law_a_forcing_has_to_explain_the_recording(channel: Channel) -> None:
    [constant, *_] = channel.library
    null = channel.objective(channel.recorded([("1", 0.05)]), [constant])
    begin = torch.zeros(null.modes + 1, dtype=torch.float64)
    forcing, _ = fit_free_forcing(null, begin, channel.size)
    whole = LinearisedForcing(forcing.objective, forcing.block, forcing.normal)
    alone = whole.without_law()
    assert whole.own == null.modes + 1 and alone.own == null.modes
    torch.testing.assert_close(alone.normal.target, forcing.normal.target)
    assert alone.normal.jacobian.shape[1] == forcing.normal.jacobian.shape[1] - 1
