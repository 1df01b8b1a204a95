"""The law of an assimilation with dynamics, taken from latent SINDy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest
import torch
from lightning import Trainer

from callbacks import LatentDiscovery, LatentLaw
from dashred.models.dynamics.network_assimilation import NetworkAssimilation
from tests.models.dynamics.test_dynamic_assimilation import built, data, real, shred, system

__all__ = ["data", "real", "shred", "system"]


@pytest.mark.parametrize(("epoch", "taken"), [(3, True), (4, False)])
def test_the_proposal_of_the_epoch_is_taken(system, shred, data, epoch: int, taken: bool) -> None:
    module = built(NetworkAssimilation, system, shred, data)
    proposals = {"alg1": [[0.0] * 8, [0.0, -0.3, *[0.0] * 6]], "alg2": [[1.0] * 8] * 2}
    discovery = SimpleNamespace(epochs=[1, 3], history=proposals)
    callback = LatentLaw(cast(LatentDiscovery, discovery), "alg1")
    trainer = SimpleNamespace(current_epoch=epoch - 1)
    callback.on_train_epoch_end(cast(Trainer, trainer), module)
    expected = torch.zeros(8).double()
    if taken:
        expected[1] = -0.3
    torch.testing.assert_close(module.dynamics.coefficients.detach(), expected)
    assert int(module.dynamics.support.sum()) == int(taken)
