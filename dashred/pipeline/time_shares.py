"""How the time of a run is divided among its stages."""

from __future__ import annotations

from dashred.config import Config
from dashred.core.budget import Budget

# Seconds that an analysis may take, by the number of axes.
DEFAULT_SECONDS = (300.0, 300.0, 600.0)
# Share of the whole time after which a stage ends. Time that a stage leaves goes to the later ones.
ENDS = {
    "simulate": 0.3,
    "search over segments": 0.4,
    "simulate the ensemble": 0.5,
    "train SHRED": 0.55,
    "assimilate": 0.6,
    "fit the first guesses": 0.64,
    "grow the horizon": 0.7,
    "select the law": 0.74,
    "fit the law to the end": 0.77,
    "compare hypotheses": 0.85,
    "corrected ensemble": 0.88,
    "train corrected SHRED": 0.93,
    "draw figures": 0.98,
}


def begin_budget(config: Config) -> Budget:
    """Return the budget of a run that begins now."""
    default = DEFAULT_SECONDS[len(config.system.axes)]
    return Budget.begin(default if config.budget is None else config.budget)
