"""Proper orthogonal decomposition."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.models import pod as pod_module
from dashred.models.pod import POD


def random(*shape, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def low_rank(samples, rank=3, grid=(4, 5)):
    """Return states of rank ``rank`` with two fields in very different units."""
    shapes = random(rank, 2, *grid, seed=1)
    states = torch.einsum("sr,rf...->sf...", random(samples, rank), shapes) + random(2, *grid)
    return states * torch.tensor([1.0, 1e4], dtype=torch.float64).reshape(2, 1, 1)


@pytest.mark.parametrize("samples", [12, 400])
def test_modes_are_orthonormal_and_the_energy_is_ordered(samples):
    pod = POD.fit(random(samples, 2, 4, 5), 8)
    assert pod.modes.shape == (8, 40)
    identity = torch.eye(8, dtype=torch.float64)
    torch.testing.assert_close(pod.modes @ pod.modes.T, identity, atol=1e-10, rtol=0)
    assert (pod.modes.amax(dim=1) == pod.modes.abs().amax(dim=1)).all()
    assert (pod.energy.diff() <= 0).all()
    assert 0 < pod.energy.sum() < 1


@pytest.mark.parametrize("samples", [12, 400])
def test_low_rank_states_are_exact_and_ask_for_no_more_modes(samples):
    states = low_rank(samples)
    pod = POD.fit(states, 10)
    assert pod.modes.shape[0] == 3
    torch.testing.assert_close(pod.decode(pod.encode(states)), states, rtol=1e-6, atol=1e-6)
    assert pod.energy.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("samples", [12, 400])
def test_energy_is_the_variance_of_the_modes(samples):
    states = random(samples, 2, 4, 5)
    pod = POD.fit(states, 5)
    lost = (pod.decode(pod.encode(states)) - states) / pod.scale[:, None, None]
    whole = (states - states.mean(dim=0)) / pod.scale[:, None, None]
    share = lost.square().sum() / whole.square().sum()
    torch.testing.assert_close(1 - pod.energy.sum(), share)


def test_no_basis_of_the_same_size_loses_less():
    states = random(60, 1, 16)
    pod = POD.fit(states, 4)
    flat = (states - states.mean(dim=0)).reshape(60, -1)
    other = torch.linalg.qr(random(16, 4, seed=5)).Q
    best = (pod.decode(pod.encode(states)) - states).square().sum()
    assert best < (flat - flat @ other @ other.T).square().sum()
    singular = torch.linalg.svdvals(flat)
    torch.testing.assert_close(best, singular[4:].square().sum())


def test_fields_have_equal_weight_whatever_their_units():
    states = random(50, 2, 8)
    stretched = states * torch.tensor([1.0, 1e6]).reshape(2, 1)
    plain, other = POD.fit(states, 4), POD.fit(stretched, 4)
    torch.testing.assert_close(plain.modes, other.modes)


def test_shapes_of_batches_and_of_ode_states():
    pod = POD.fit(low_rank(20), 3)
    states = low_rank(6).reshape(2, 3, 2, 4, 5)
    assert pod.encode(states).shape == (2, 3, 3)
    assert pod.decode(pod.encode(states)).shape == states.shape
    assert pod.encode(states[0, 0]).shape == (3,)
    flat = POD.fit(random(30, 2), 2)
    torch.testing.assert_close(flat.decode(flat.encode(random(4, 2))), random(4, 2))


def test_the_dtype_is_kept_and_the_basis_travels_as_buffers():
    pod = POD.fit(low_rank(20), 3)
    assert pod.encode(low_rank(4).float()).dtype is torch.float32
    assert pod.decode(torch.zeros(3)).dtype is torch.float32
    assert set(pod.state_dict()) == {"mean", "modes", "scale", "energy"}


def test_a_constant_field_does_no_harm_but_constant_states_have_no_modes():
    states = random(30, 2, 8)
    states[:, 1] = 0.3
    pod = POD.fit(states, 4)
    torch.testing.assert_close(pod.decode(pod.encode(states))[:, 1], states[:, 1])
    with pytest.raises(ValueError, match="no modes"):
        POD.fit(torch.ones(10, 2, 8, dtype=torch.float64), 4)


def test_many_samples_of_many_cells_have_the_modes_of_some(monkeypatch):
    monkeypatch.setattr(pod_module, "LARGEST_GRAM", 20)
    states = low_rank(400)
    pod = POD.fit(states, 10)
    assert pod.modes.shape[0] == 3
    torch.testing.assert_close(pod.decode(pod.encode(states)), states, rtol=1e-6, atol=1e-6)
    assert torch.equal(pod.modes, POD.fit(states, 10).modes)


def test_what_is_left_out_is_the_part_beyond_the_modes() -> None:
    angle = torch.linspace(0, 2 * torch.pi, 65, dtype=torch.float64)[:-1]
    amplitude = torch.linspace(-1, 1, 41, dtype=torch.float64)[:, None, None]
    kept, rest = amplitude * torch.sin(angle), amplitude.square() * torch.sin(5 * angle)
    pod = POD.fit(kept, 4)
    assert pod.left_out(kept) < 1e-12
    both = kept + 0.1 * rest
    expected = 0.1 * rest.square().mean().sqrt() / both.std(correction=0)
    assert pod.left_out(both) == pytest.approx(float(expected), rel=1e-9)
    assert math.isnan(pod.left_out(torch.zeros_like(both)))


def test_other_modes_have_the_energy_of_those_that_stay() -> None:
    pod = POD.fit(random(12, 2, 4, 5), 3)
    further = random(2, 40)
    more = pod.with_modes(torch.cat([pod.modes, further]))
    assert more.energy.tolist() == [*pod.energy.tolist(), 0.0, 0.0]
    assert torch.equal(more.with_modes(pod.modes).energy, pod.energy)
