"""SHRED: shapes, checkpoints, and a reconstruction that depends on the latent state."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from lightning import Trainer, seed_everything
from torch import Tensor

from dashred.models.lag_windows import windows
from dashred.models.pod import POD
from dashred.models.scaler import Scaler
from dashred.models.shred import SHRED, reconstruct
from dashred.models.simulation_training import SimulationTraining, _share_noise
from datamodules.batches import ordered_batches, shuffled_batches

LAGS, POINTS, SENSORS = 8, 32, 3
STEPS = 500


def waves(members: int, seed: int) -> Tensor:
    """Return travelling waves of random phase and speed, ``(member, time, field, x)``."""
    generator = torch.Generator().manual_seed(seed)
    phase = 2 * math.pi * torch.rand(members, 1, 1, 1, generator=generator)
    speed = 0.5 + torch.rand(members, 1, 1, 1, generator=generator)
    t = 0.2 * torch.arange(30).reshape(-1, 1, 1)
    x = torch.arange(POINTS) * 2 * math.pi / POINTS
    angle = (x - speed * t - phase).double()
    return torch.cat([angle.sin() + 0.5 * (2 * angle).cos(), 3 * angle.cos()], dim=2)


def sensed(states: Tensor) -> Tensor:
    """Three sensors of the first field, close together."""
    return states[..., 0, [0, 3, 7]]


def make(states: Tensor, modes: int = 4) -> SHRED:
    pod = POD.fit(states.flatten(0, 1), modes)
    spread = pod.encode(states).flatten(0, 1).std(dim=0)
    return SHRED(Scaler.fit(sensed(states)), pod, spread, 16, 2, [32]).float()


@pytest.fixture(scope="module")
def trained() -> SHRED:
    """SHRED, trained for a few seconds on forty waves."""
    seed_everything(0, verbose=False)
    states = waves(40, seed=0)
    shred = make(states)
    stretches = windows(sensed(states), 2 * LAGS)[:, LAGS::4].flatten(0, 1).float()
    coefficients = shred.pod.encode(states.float())
    ends = range(LAGS, coefficients.shape[1], 4)
    targets = torch.stack([coefficients[:, end - LAGS : end + 1] for end in ends], dim=1)
    module = SimulationTraining(shred, torch.zeros(SENSORS), 2 * POINTS, 1e-2, STEPS)
    trainer = quiet_trainer(max_steps=STEPS, max_epochs=-1, num_sanity_val_steps=0)
    unseen = windows(sensed(states[:2]), LAGS).flatten(0, 1).float()
    trainer.fit(
        module,
        shuffled_batches((stretches, targets.flatten(0, 1), none_repeated(stretches)), 32, seed=0),
        ordered_batches((unseen, coefficients[:2].flatten(0, 1)), 100),
    )
    return module.shred.eval()


def none_repeated(stretches: torch.Tensor) -> torch.Tensor:
    return torch.zeros(len(stretches), dtype=torch.long)


def quiet_trainer(**settings: Any) -> Trainer:
    return Trainer(
        accelerator="cpu",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        **settings,
    )


def relative_error(found: Tensor, truth: Tensor) -> float:
    """Return the RMSE over all fields, each in units of its std."""
    std = truth.transpose(0, 1).flatten(1).std(dim=1).reshape(-1, 1)
    return float(((found - truth) / std).square().mean().sqrt())


def test_shapes():
    shred = make(waves(4, seed=1))
    seen = torch.randn(5, LAGS + 1, SENSORS)
    latent = shred.encode(seen)
    assert latent.shape == (5, 16)
    assert shred.coefficients(latent).shape == (5, 4)
    assert shred(seen).shape == (5, 2, POINTS)
    assert shred.encode_sequence(seen).shape == (5, LAGS + 1, 16)
    field = reconstruct(shred.encode, shred, seen)
    assert field.dtype == torch.float64
    assert not field.requires_grad


def test_a_window_is_encoded_as_the_last_sample_of_its_stretch():
    shred = make(waves(4, seed=1))
    stretch = torch.randn(3, 2 * LAGS, SENSORS)
    along = shred.encode_sequence(stretch)
    assert torch.equal(shred.encode(stretch), along[:, -1])
    # Later samples have no effect.
    torch.testing.assert_close(shred.encode(stretch[:, :LAGS]), along[:, LAGS - 1])


def test_the_latent_reads_the_sensors_in_units_of_their_own_spread():
    states = waves(4, seed=1)
    seen = sensed(states)[0, :6][None].float()
    torch.manual_seed(0)
    shred = make(states)
    torch.manual_seed(0)
    other_units = make(torch.cat([1000 * states[:, :, :1] + 7, states[:, :, 1:]], dim=2))
    torch.testing.assert_close(
        shred.encode(seen), other_units.encode(1000 * seen + 7), rtol=1e-3, atol=1e-4
    )


def test_a_checkpoint_carries_the_scaler_and_the_basis(tmp_path):
    states = waves(4, seed=1)
    shred, other = make(states), make(3 * waves(4, seed=2) + 1)
    seen = sensed(states)[:, : LAGS + 1].float()
    assert not torch.allclose(shred(seen), other(seen), atol=0.1)
    torch.save(shred.state_dict(), tmp_path / "shred.pt")
    other.load_state_dict(torch.load(tmp_path / "shred.pt"))
    assert torch.equal(shred(seen), other(seen))
    names = {"scaler.mean", "scaler.std", "pod.mean", "pod.modes", "pod.scale", "spread"}
    assert names <= shred.state_dict().keys()


def test_a_network_can_be_initialised_from_one_with_other_modes():
    states = waves(4, seed=0)
    before, after = make(states), make(states, modes=3)
    after.initialise_from(before)
    for name, value in after.state_dict().items():
        if name.startswith("encoder.") or name in ("decoder.0.weight", "decoder.0.bias"):
            torch.testing.assert_close(value, before.state_dict()[name])
    stretch = sensed(states).float()
    torch.testing.assert_close(after.encode(stretch), before.encode(stretch))
    assert after.decode(after.encode(stretch)).shape == before.decode(before.encode(stretch)).shape


def test_squared_error_is_that_of_the_field():
    states = waves(4, seed=1)
    shred = make(states)
    module = SimulationTraining(shred, torch.zeros(SENSORS), 2 * POINTS, 1e-3, 10)
    latent = torch.randn(6, 16)
    truth = torch.randn(6, 4)
    scale = shred.pod.scale[:, None]
    difference = (shred.decode(latent) - shred.pod.decode(truth)) / scale
    expected = difference.square().mean(dim=(1, 2))
    torch.testing.assert_close(module.squared_error(latent, truth), expected)


def test_fresh_noise_is_drawn_for_every_batch():
    states = waves(4, seed=1)
    module = SimulationTraining(make(states), torch.full((SENSORS,), 0.1), 2 * POINTS, 1e-3, 10)
    module.log = lambda *args, **kwargs: None  # type: ignore[method-assign]
    stretches = torch.randn(4, 2 * LAGS + 1, SENSORS)
    batch = (stretches, torch.randn(4, LAGS + 1, 4), none_repeated(stretches))
    torch.manual_seed(0)
    assert module.training_step(batch, 0) != module.training_step(batch, 0)
    module.noise.zero_()
    assert module.training_step(batch, 0) == module.training_step(batch, 0)


def test_what_repeats_a_sample_repeats_its_noise():
    noise = torch.randn(3, 2 * LAGS + 1, SENSORS)
    found = _share_noise(noise, torch.tensor([0, LAGS, 2]))
    assert torch.equal(found[0], noise[0])
    assert torch.equal(found[1, :LAGS], noise[1, LAGS].expand(LAGS, SENSORS))
    assert torch.equal(found[1, LAGS:], noise[1, LAGS:])
    assert torch.equal(found[2, :2], noise[2, 2].expand(2, SENSORS))
    assert torch.equal(found[2, 2:], noise[2, 2:])


def test_it_learns_travelling_waves(trained):
    unseen = waves(10, seed=9)
    seen = windows(sensed(unseen), LAGS).flatten(0, 1).float()
    error = relative_error(reconstruct(trained.encode, trained, seen), unseen.flatten(0, 1))
    assert error < 0.08


def test_shuffling_the_latent_over_time_destroys_the_reconstruction(trained):
    unseen = waves(10, seed=9)
    seen = windows(sensed(unseen), LAGS).flatten(0, 1).float()
    truth = unseen.flatten(0, 1).float()
    with torch.no_grad():
        latent = trained.encode(seen)
        order = torch.randperm(len(latent), generator=torch.Generator().manual_seed(0))
        honest = relative_error(trained.decode(latent), truth)
        shuffled = relative_error(trained.decode(latent[order]), truth)
    assert shuffled > 10 * honest
    assert shuffled > 1.0  # worse than the mean field


def test_validation_logs_the_root_of_the_mean_square():
    states = waves(4, seed=1)
    module = SimulationTraining(make(states), torch.zeros(SENSORS), 2 * POINTS, 1e-3, 10)
    seen = windows(sensed(states), LAGS).flatten(0, 1).float()
    coefficients = module.shred.pod.encode(states.float()).flatten(0, 1)
    trainer = quiet_trainer()
    trainer.validate(module, ordered_batches((seen, coefficients), 50), verbose=False)
    with torch.no_grad():
        expected = module.squared_error(module.shred.encode(seen), coefficients).mean().sqrt()
    assert float(trainer.callback_metrics["rmse/field_members"]) == pytest.approx(
        float(expected), rel=1e-5
    )
