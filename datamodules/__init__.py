"""LightningDataModules: the simulated ensemble and the real recording."""

from datamodules.recording import EpisodesDataModule, RecordingDataModule
from datamodules.simulation import SimulationDataModule
from datamodules.whole_recording import WholeRecordingDataModule

__all__ = [
    "EpisodesDataModule",
    "RecordingDataModule",
    "SimulationDataModule",
    "WholeRecordingDataModule",
]
