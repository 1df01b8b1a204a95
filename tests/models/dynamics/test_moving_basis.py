"""The modes that an assimilation adds to its basis."""

from __future__ import annotations

import pytest
import torch

from dashred.models.dynamics import moving_basis
from dashred.models.dynamics.moving_basis import NEGLIGIBLE, outside
from tests.models.dynamics.test_dynamic_assimilation import data, make, network, real, shred, system

__all__ = ["data", "real", "shred", "system"]


def test_the_modes_express_what_the_basis_cannot(system, shred, data, real):
    dynamics, pod = make(system, shred, data).dynamics, network(system, 3).pod
    found = outside(pod, dynamics, real, 1e-3)
    assert found is not None
    forecasts = dynamics.forecasts(real)
    left = forecasts - pod.decode(pod.encode(forecasts))
    scale = float(pod.scale[0])
    assert found.rms == pytest.approx(float((left / scale).square().mean().sqrt()), rel=1e-6)
    extended = pod.with_modes(torch.cat([pod.modes, found.modes]))
    gram = extended.modes @ extended.modes.T
    torch.testing.assert_close(gram, torch.eye(len(gram)), atol=1e-5, rtol=0)
    left = forecasts - extended.decode(extended.encode(forecasts))
    assert float((left / scale).square().mean().sqrt()) < 0.03 * 1e-3
    torch.testing.assert_close(found.left, left, atol=1e-5, rtol=0)
    values = (extended.encode(forecasts)[:, 3:]).square().mean(dim=0).sqrt()
    torch.testing.assert_close(found.spread, values.float(), rtol=1e-3, atol=1e-6)


def test_no_more_modes_are_taken_than_q_needs(system, shred, data, real):
    dynamics, pod = make(system, shred, data).dynamics, network(system, 3).pod
    needed = outside(pod, dynamics, real, 1e-3)
    assert needed is not None
    counts = []
    for share in (0.3, 1.1):
        found = outside(pod, dynamics, real, share * needed.rms / NEGLIGIBLE)
        assert found is not None
        counts.append(len(found.modes))
    assert len(needed.modes) > counts[0] > counts[1] == 0
    whole = outside(shred.pod, dynamics, real, 1e-3)
    assert whole is not None and len(whole.modes) == 0 and whole.rms < 1e-6


def test_a_forecast_that_blows_up_adds_nothing(system, shred, data, real):
    module = make(system, shred, data)
    blown = real.clone()
    blown[3] = torch.inf
    assert outside(module.shred.pod, module.dynamics, blown, 1e-3) is None
    module.basis.grow(module.dynamics, blown, 1e-3)
    assert len(module.shred.spread) == 7 and module.basis.outside == 0.0


def test_new_modes_leave_the_field_and_the_guess_as_they_are(system, data, real):
    module = make(system, network(system, 4), data)
    before, guess = module.fields(data.windows), module.basis.guess
    module.basis.grow(module.dynamics, real, 1e-3)
    assert len(module.shred.spread) > 4 and module.basis.outside > 1e-3
    torch.testing.assert_close(module.fields(data.windows), before)
    assert torch.equal(module.basis.guess[:, :4], guess)
    assert not module.basis.guess[:, 4:].any()


def test_what_no_mode_expresses_counts_as_noise(system, data, real, monkeypatch):
    monkeypatch.setattr(moving_basis, "MOST_MODES", 1)
    module = make(system, network(system, 3), data)
    noise = module.sensors.noise.clone()
    found = outside(module.shred.pod, module.dynamics, real, 1e-3)
    assert found is not None
    module.basis.grow(module.dynamics, real, 1e-3)
    left = module.sensors.fit(found.left).square().mean(dim=0).sqrt().float()
    torch.testing.assert_close(module.sensors.noise, torch.hypot(noise, left))
    assert float(left.max()) > 1e-3


def test_without_an_adapter_the_basis_stays(system, data, real):
    module = make(system, network(system, 4), data, adapter=False)
    module.basis.grow(module.dynamics, real, 1e-3)
    assert len(module.shred.pod.modes) == 4
