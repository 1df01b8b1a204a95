"""SHRED's training data: no held-out members, and targets at the right times."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dashred.data.observation_operator import ObservationOperator
from dashred.physics.runs.ensemble import Ensemble
from datamodules import SimulationDataModule
from datamodules.simulation import LAST_REPEATS
from tests import ring

LAGS, MEMBERS, HELD_OUT, MODES = 6, 14, 5, 7
SENSORS = ring.SENSORS[:4]


@pytest.fixture
def system(tmp_path):
    return ring.linear_system(tmp_path)


@pytest.fixture
def ensemble(system) -> Ensemble:
    return ring.ensemble(system, MEMBERS)


def make(system, ensemble: Ensemble, seed: int = 0, held_out: int = HELD_OUT):
    operator = ObservationOperator(SENSORS, system)
    noise = torch.full((4,), 0.05, dtype=torch.float64)
    return SimulationDataModule(ensemble, operator, noise, LAGS, MODES, held_out, 16, seed)


def test_held_out_members_change_neither_scaler_nor_basis(system, ensemble):
    other = ensemble.states.clone()
    other[MEMBERS - HELD_OUT :] = 100 * other[MEMBERS - HELD_OUT :].flip(-1) + 3
    first, second = make(system, ensemble), make(system, replace(ensemble, states=other))
    for name, value in first.scaler.state_dict().items():
        assert torch.equal(value, second.scaler.state_dict()[name])
    for name, value in first.pod.state_dict().items():
        assert torch.equal(value, second.pod.state_dict()[name])
    assert torch.equal(first.spread, second.spread)
    # The last training member does change them.
    other = ensemble.states.clone()
    other[MEMBERS - HELD_OUT - 1] *= 2
    third = make(system, replace(ensemble, states=other))
    assert not torch.equal(first.scaler.std, third.scaler.std)
    assert not torch.equal(first.pod.modes, third.pod.modes)


def test_scales_are_those_of_the_training_members(system, ensemble):
    data = make(system, ensemble)
    traces = data.operator(ensemble.states[: MEMBERS - HELD_OUT]).flatten(0, 1)
    torch.testing.assert_close(data.scaler.mean, traces.mean(dim=0))
    torch.testing.assert_close(data.scaler.std, traces.std(dim=0, correction=0))
    torch.testing.assert_close(data.spread, data.coefficients("train").flatten(0, 1).std(dim=0))


@pytest.mark.parametrize("held_out", [1, 2, 5, 8])
def test_every_member_has_one_part(system, ensemble, held_out):
    data = make(system, ensemble, held_out=held_out)
    parts = [list(data.members[part]) for part in ("train", "validation", "test")]
    assert sorted(member for part in parts for member in part) == list(range(MEMBERS))
    assert len(parts[0]) == MEMBERS - held_out
    assert parts[1]  # early stopping needs a member


def test_a_stretch_ends_when_its_last_target_does(system, ensemble):
    data = make(system, ensemble)
    stretches, targets, repeated = data.train_dataloader().dataset.tensors
    assert stretches.shape[1:] == (LAGS + 1, 4)
    assert targets.shape[1:] == (LAGS // 2 + 1, MODES)
    assert len(stretches) == len(targets) == len(repeated)
    for stretch, copies in zip(stretches, repeated.tolist(), strict=True):
        assert (stretch[: copies + 1] == stretch[0]).all()
        assert copies == LAGS or not torch.equal(stretch[copies], stretch[copies + 1])
    assert {LAGS, 0} <= set(repeated.tolist())
    # Sensor values and coefficients of a sample belong to one field, exact with seven modes;
    # also where the first sample is repeated.
    field = data.pod.decode(targets.double())
    torch.testing.assert_close(
        data.operator(field).float(), stretches[:, -LAGS // 2 - 1 :], rtol=1e-4, atol=1e-4
    )
    known = data.coefficients("train").flatten(0, 1).float()
    assert all((known == last).all(dim=1).any() for last in targets[:, -1])


def test_every_sample_of_a_record_is_trained_on_its_own_coefficient(system, ensemble):
    data = make(system, ensemble)
    stretches, targets, _ = data.train_dataloader().dataset.tensors
    per_member = len(stretches) // (MEMBERS - HELD_OUT)
    last = len(ring.TIMES) - 1
    ends = [*range(0, last, max(1, LAGS // 4)), last]
    assert per_member == len(ends) + LAST_REPEATS
    assert last - ends[-2] <= LAGS // 2 + 1  # no gap between the targets
    for member, place in ((0, 0), (3, 5), (8, len(ends) - 1), (2, per_member - 1)):
        row, end = member * per_member + place, ends[min(place, len(ends) - 1)]
        state = ensemble.states[member, end]
        torch.testing.assert_close(targets[row, -1], data.pod.encode(state[None])[0].float())
        torch.testing.assert_close(stretches[row, -1], data.operator(state[None])[0].float())


def test_batches_are_repeatable_by_seed(system, ensemble):
    first, again, other = (
        [batch[0] for batch in make(system, ensemble, seed).train_dataloader()]
        for seed in (3, 3, 4)
    )
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(first[0], other[0])
    assert torch.equal(torch.cat(first).sum(dim=0).round(), torch.cat(other).sum(dim=0).round())


def test_each_epoch_has_another_order(system, ensemble):
    loader = make(system, ensemble).train_dataloader()
    once, twice = (next(iter(loader))[0] for _ in range(2))
    assert not torch.equal(once, twice)


def test_training_stretches_are_clean_and_held_out_windows_noisy(system, ensemble):
    data = make(system, ensemble)
    for part in ("validation", "test"):
        noisy = data.noisy_windows(part)
        error = noisy[:, :, -1] - data.observed(part)
        assert float(error.std()) == pytest.approx(0.05, rel=0.15)
        assert torch.equal(noisy, data.noisy_windows(part))
    other = make(system, ensemble, seed=1)
    assert not torch.equal(other.noisy_windows("test"), data.noisy_windows("test"))


def test_the_noise_of_validation_and_test_differs(system, ensemble):
    data = make(system, ensemble, held_out=4)
    errors = [
        data.noisy_windows(part)[:, :, -1] - data.observed(part) for part in ("validation", "test")
    ]
    assert not torch.allclose(*errors)


def test_validation_windows_go_with_the_coefficients_of_their_last_sample(system, ensemble):
    data = make(system, ensemble)
    data.noise.zero_()
    seen, coefficients = next(iter(data.val_dataloader()))
    assert len(seen) == len(data.members["validation"]) * len(ring.TIMES)
    read = data.operator(data.pod.decode(coefficients.double())).float()
    torch.testing.assert_close(read, seen[:, -1], rtol=1e-4, atol=1e-4)
