"""LightningModule 1: train SHRED on the simulated ensemble."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from lightning import LightningModule
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor

from dashred.models.shred import SHRED
from dashred.models.validation_error import log_rmse, log_squares

Sequences = tuple[
    Float[Tensor, "batch time sensor"], Float[Tensor, "batch target mode"], Int[Tensor, " batch"]
]
Windows = tuple[Float[Tensor, "batch lag sensor"], Float[Tensor, "batch mode"]]


class SimulationTraining(LightningModule):
    """Minimise the mean squared error of the field, ``Σ_modes (â - a)² / cells``.

    The error is in units of each field's std. New sensor noise is drawn for every batch, so that
    the network does not rely on noise-free histories.

    Args:
        shred: the network.
        noise: std of each input sensor, ``(sensor,)``, in its own unit.
        cells: number of (field, grid point) pairs over which an RMSE averages.
        rate: peak learning rate.
        steps: total number of optimiser steps; the learning rate makes one cycle.
    """

    noise: Tensor

    def __init__(self, shred: SHRED, noise: Tensor, cells: int, rate: float, steps: int) -> None:
        super().__init__()
        self.shred, self.cells = shred, cells
        self.rate, self.steps = rate, steps
        self.register_buffer("noise", noise)

    def on_fit_start(self) -> None:
        """Give each further process noise of its own."""
        if self.global_rank > 0:
            torch.manual_seed(torch.initial_seed() + self.global_rank)

    def training_step(self, batch: Sequences, index: int) -> Tensor:
        """Return the loss of one batch of sequences, over the samples that have targets."""
        sequences, targets, repeated = batch
        noisy = sequences + self.noise * _share_noise(torch.randn_like(sequences), repeated)
        latent = self.shred.encode_sequence(noisy)[:, -targets.shape[1] :]
        loss = self.squared_error(latent, targets).mean()
        self.log("loss/train", loss, on_step=False, on_epoch=True, sync_dist=True)
        return loss

    def validation_step(self, batch: Windows, index: int) -> None:
        """Log the RMSE of the field on held-out members, in units of each field's std."""
        windows, coefficients = batch
        error = self.squared_error(self.shred.encode(windows), coefficients).mean()
        log_squares(self, "field_members", error, len(windows))

    def on_validation_epoch_end(self) -> None:
        """Log the RMSE, which early stopping monitors."""
        log_rmse(self, "field_members")

    def squared_error(
        self, latent: Float[Tensor, "*batch latent"], coefficients: Float[Tensor, "*batch mode"]
    ) -> Float[Tensor, "*batch"]:
        """Return the squared error of each latent state, averaged over fields and grid points."""
        found = self.shred.coefficients(latent)
        return (found - coefficients).square().sum(dim=-1) / self.cells

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Return AdamW under a one-cycle schedule."""
        # Without `fused`, updating the weights is a fifth of the training time of a small network.
        optimizer = torch.optim.AdamW(
            self.shred.parameters(), lr=self.rate, weight_decay=1e-4, fused=True
        )
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, max_lr=self.rate, total_steps=self.steps, pct_start=0.15
        )
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": schedule, "interval": "step"},
        }


def _share_noise(
    noise: Float[Tensor, "batch time sensor"], repeated: Int[Tensor, " batch"]
) -> Float[Tensor, "batch time sensor"]:
    """Return the noise with one draw for all copies of a repeated first sample.

    In a recording the repeated sample has the same noise in all copies. With independent draws,
    the network would learn to average over the copies.
    """
    held = torch.arange(noise.shape[1], device=noise.device)
    held = torch.maximum(held, repeated[:, None])
    return noise.gather(1, held[..., None].expand_as(noise))
