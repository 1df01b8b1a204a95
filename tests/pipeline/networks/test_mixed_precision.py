"""SHRED in mixed precision gives the same kind of network; all else stays as it is."""

from __future__ import annotations

import pytest
import torch

from dashred.core.tracking import NullTracker
from dashred.models.device import trains_in_bfloat16
from dashred.pipeline.networks.assimilation import assimilate
from tests.pipeline.networks.conftest import Configured
from tests.pipeline.networks.fits import fit_networks

# The significand of bfloat16 has 8 bits: a product is off by 0.4 % at most, and the errors of many
# products cancel in part. The RMSE of a network may change by as much.
PRECISION = 2.0**-8


@pytest.mark.skipif(not trains_in_bfloat16(), reason="needs a CPU with AVX-512")
def test_shred_in_bfloat16_is_as_good_as_in_float32(configured: Configured) -> None:
    full = fit_networks(configured()).shred
    mixed = fit_networks(configured("trainer.precision=bf16-mixed")).shred
    weights = mixed.shred.state_dict()
    assert {name: value.dtype for name, value in weights.items()} == {
        name: value.dtype for name, value in full.shred.state_dict().items()
    }
    # The weights differ: the precision reached the trainer.
    assert any(not torch.equal(v, full.shred.state_dict()[name]) for name, v in weights.items())
    losses = [value for _, value in mixed.curves["loss/train"]]
    assert losses[-1] < 0.7 * losses[0]
    assert mixed.test_rmse["all"] == pytest.approx(full.test_rmse["all"], rel=PRECISION)


def test_the_assimilation_stays_in_float32(configured: Configured) -> None:
    full = configured()
    networks = fit_networks(full)
    mixed = configured("trainer.precision=bf16-mixed")
    again = assimilate(mixed.problem, mixed.nominal, networks.shred, NullTracker(), {})
    assert torch.equal(again.dashred, networks.assimilated.dashred)
    assert again.coefficients == networks.assimilated.coefficients
