"""Assimilation with dynamics: the second LightningModule follows the simulator too."""
