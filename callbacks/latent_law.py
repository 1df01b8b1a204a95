"""Callback that takes the law of an assimilation with dynamics from latent SINDy."""

from __future__ import annotations

import torch
from lightning import Callback, LightningModule, Trainer

from callbacks.latent_discovery import LatentDiscovery
from dashred.models.dynamics.network_assimilation import NetworkAssimilation


class LatentLaw(Callback):
    """Let the next epoch fit the terms that an algorithm proposes at the end of this one.

    Args:
        discovery: runs latent SINDy, as a callback before this one.
        algorithm: ``alg1`` or ``alg2``.
    """

    def __init__(self, discovery: LatentDiscovery, algorithm: str) -> None:
        self._discovery, self._algorithm = discovery, algorithm

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Take the proposal, if latent SINDy has run at this epoch."""
        assert isinstance(pl_module, NetworkAssimilation)
        epochs = self._discovery.epochs
        if epochs and epochs[-1] == trainer.current_epoch + 1:
            proposed = self._discovery.history[self._algorithm][-1]
            law = torch.zeros_like(pl_module.dynamics.scales)
            # Latent SINDy has no candidates beside the terms of the library.
            law[: len(proposed)] = torch.tensor(proposed, dtype=torch.float64)
            pl_module.dynamics.set_law(law)
