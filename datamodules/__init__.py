"""LightningDataModules: the simulated ensemble and the real recording."""

from datamodules.recording import RecordingDataModule
from datamodules.simulation import SimulationDataModule

__all__ = ["RecordingDataModule", "SimulationDataModule"]
