"""LightningDataModules: the simulated ensemble and the real recording."""

from datamodules.recording import EpisodesDataModule, RecordingDataModule
from datamodules.simulation import SimulationDataModule

__all__ = ["EpisodesDataModule", "RecordingDataModule", "SimulationDataModule"]
