"""Lightning callbacks: latent discovery, RMSE curves, progress and the best state."""

from callbacks.best_state import BestState
from callbacks.latent_discovery import LatentDiscovery
from callbacks.progress import StageProgress
from callbacks.rmse_curves import RMSECurves

__all__ = ["BestState", "LatentDiscovery", "RMSECurves", "StageProgress"]
