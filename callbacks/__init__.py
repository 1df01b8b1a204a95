"""Lightning callbacks: latent discovery, RMSE curves, progress, the best state, a deadline."""

from callbacks.best_state import BestState
from callbacks.latent_discovery import LatentDiscovery
from callbacks.latent_law import LatentLaw
from callbacks.law_selection import LawSelection
from callbacks.progress import StageProgress
from callbacks.rmse_curves import RMSECurves
from callbacks.time_limit import TimeLimit

__all__ = [
    "BestState",
    "LatentDiscovery",
    "LatentLaw",
    "LawSelection",
    "RMSECurves",
    "StageProgress",
    "TimeLimit",
]
