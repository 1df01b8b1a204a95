"""LightningModule 1: train SHRED on the simulated ensemble."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from lightning import LightningModule
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor

from dashred.models.shred import SHRED

Stretches = tuple[
    Float[Tensor, "batch time sensor"], Float[Tensor, "batch target mode"], Int[Tensor, " batch"]
]
Windows = tuple[Float[Tensor, "batch lag sensor"], Float[Tensor, "batch mode"]]


class SimulationTraining(LightningModule):
    """Minimise the field's mean squared error, ``Σ_modes (â - a)²`` in units of each field's std.

    Fresh sensor noise is drawn for every batch: the network must not count on clean histories.

    Args:
        shred: the network.
        noise: std of each input sensor, ``(sensor,)``, in its own unit.
        cells: number of (field, grid point) pairs that an RMSE averages over.
        rate: peak learning rate.
        steps: optimiser steps in all: the learning rate makes one cycle.
    """

    noise: Tensor

    def __init__(self, shred: SHRED, noise: Tensor, cells: int, rate: float, steps: int) -> None:
        super().__init__()
        self.shred, self.cells = shred, cells
        self.rate, self.steps = rate, steps
        self.register_buffer("noise", noise)

    def training_step(self, batch: Stretches, index: int) -> Tensor:
        """Return the loss of one batch of stretches, over the samples that have targets."""
        stretches, targets, repeated = batch
        noisy = stretches + self.noise * _drawn_once(torch.randn_like(stretches), repeated)
        latent = self.shred.encode_along(noisy)[:, -targets.shape[1] :]
        loss = self.squared_error(latent, targets).mean()
        self.log("loss/train", loss, on_step=False, on_epoch=True)
        return loss

    def validation_step(self, batch: Windows, index: int) -> None:
        """Log the RMSE of the field on held-out members, in units of each field's std."""
        windows, coefficients = batch
        error = self.squared_error(self.shred.encode(windows), coefficients).mean()
        self.log("mse/field_members", error, on_epoch=True, batch_size=len(windows))

    def on_validation_epoch_end(self) -> None:
        """Turn the mean square into the RMSE that early stopping watches."""
        error = self.trainer.callback_metrics["mse/field_members"]
        self.log("rmse/field_members", error.sqrt())

    def squared_error(
        self, latent: Float[Tensor, "*batch latent"], coefficients: Float[Tensor, "*batch mode"]
    ) -> Float[Tensor, "*batch"]:
        """Return the squared error of each latent state, averaged over fields and grid points."""
        found = self.shred.coefficients(latent)
        return (found - coefficients).square().sum(dim=-1) / self.cells

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Return AdamW under a one-cycle schedule."""
        optimizer = torch.optim.AdamW(self.shred.parameters(), lr=self.rate, weight_decay=1e-4)
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, max_lr=self.rate, total_steps=self.steps, pct_start=0.15
        )
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": schedule, "interval": "step"},
        }


def _drawn_once(
    noise: Float[Tensor, "batch time sensor"], repeated: Int[Tensor, " batch"]
) -> Float[Tensor, "batch time sensor"]:
    """Return the noise with one draw for all copies of a sample: what a recording repeats is noisy.

    Else the network would average over copies whose noise it never meets.
    """
    held = torch.arange(noise.shape[1], device=noise.device)
    held = torch.maximum(held, repeated[:, None])
    return noise.gather(1, held[..., None].expand_as(noise))
