"""Standardisation of channels."""

from __future__ import annotations

import torch

from dashred.models.scaler import Scaler


def data():
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(5, 40, 3, generator=generator, dtype=torch.float64)
    return noise * torch.tensor([1.0, 20.0, 1e-3]) + torch.tensor([0.0, -300.0, 5.0])


def test_training_data_become_standard():
    x = data()
    z = Scaler.fit(x)(x)
    torch.testing.assert_close(z.mean(dim=(0, 1)), torch.zeros(3).double(), atol=1e-10, rtol=0)
    torch.testing.assert_close(z.std(dim=(0, 1), correction=0), torch.ones(3).double())


def test_other_data_get_the_training_scales_and_come_back():
    scaler = Scaler.fit(data())
    torch.testing.assert_close(scaler.inverse(scaler(2 * data())), 2 * data())
    mean, std = data().mean(dim=(0, 1)), data().std(dim=(0, 1), correction=0)
    torch.testing.assert_close(scaler(2 * data()), (2 * data() - mean) / std)


def test_a_constant_channel_keeps_its_unit():
    x = data()
    x[..., 1] = 0.1 + 0.2
    z = Scaler.fit(x)(x + 1)
    torch.testing.assert_close(z[..., 1], torch.ones(5, 40).double())


def test_missing_values_are_left_out():
    x = data()
    x[2, :, 1] = x[:, 3, 0] = torch.nan
    scaler = Scaler.fit(x)
    torch.testing.assert_close(scaler.mean[1], x[[0, 1, 3, 4], :, 1].mean())
    assert scaler.std.isfinite().all()


def test_scales_travel_as_buffers_and_keep_the_dtype():
    scaler = Scaler.fit(data())
    assert set(scaler.state_dict()) == {"mean", "std"}
    assert not list(scaler.parameters())
    assert scaler(data().float()).dtype is torch.float32
