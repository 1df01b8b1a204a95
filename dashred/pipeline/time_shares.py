"""How the time of a run is divided among its stages."""

from __future__ import annotations

from dashred.config import Config
from dashred.core.budget import Budget

# Seconds that an analysis may take, by the number of axes.
DEFAULT_SECONDS = (300.0, 300.0, 600.0)
# Share of the whole time after which a stage ends. Time that a stage leaves goes to the later ones.
ENDS = {
    "simulate": 0.25,
    "search over segments": 0.35,
    "simulate the ensemble": 0.4,
    "train SHRED": 0.46,
    "assimilate": 0.5,
    "fit the first guesses": 0.58,
    "look for a local cause": 0.66,
    "grow the horizon": 0.71,
    "select the law": 0.76,
    "fit the law to the end": 0.78,
    "compare hypotheses": 0.86,
    "corrected ensemble": 0.89,
    "train corrected SHRED": 0.93,
    "draw figures": 0.97,
}


def begin_budget(config: Config) -> Budget:
    """Return the budget of a run that begins now."""
    return Budget.begin(budget_seconds(config))


def budget_seconds(config: Config) -> float:
    """Return the seconds that a run may take."""
    default = DEFAULT_SECONDS[len(config.system.axes)]
    return default if config.budget is None else config.budget
