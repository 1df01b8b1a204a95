"""How the time of a run is divided among its stages."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from dashred.config import Config
from dashred.core.budget import Budget
from dashred.physics.solvers.schedule import round_up
from dashred.physics.system import System

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
    "simulate for the observer": 0.94,
    "observe": 0.95,
    "draw figures": 0.97,
}

# The same for an expensive program without axes, whose law comes from segments alone.
ENDS_OF_SEGMENTS = ENDS | {
    "simulate": 0.35,
    "search over segments": 0.75,
    "simulate the ensemble": 0.77,
    "train SHRED": 0.79,
    "assimilate": 0.8,
}
# A stage before the search for a law may take this share of the time that it and all later stages
# of the search have, counted from its beginning. What it looks for is rare, and is looked for again
# beside the law.
SHARE_OF_REST = {"look for a local cause": 1 / 4}
LAST_OF_SEARCH = "compare hypotheses"
# The free runs of a law: their number, and their length in lengths of the record. The stages before
# them end early enough for those of an expensive program, but not before this share of the time.
FREE_RUNS, FREE_LENGTH, LEAST = 4, 1.5, 0.5
# Simulations of the record that a fit of one trajectory takes, its derivatives included, and the
# share of the budget that they may take.
SIMULATIONS, SHARE = 200, 0.5


def calls_per_simulation(system: System, times: Tensor) -> int:
    """Return the number of calls of a program in a simulation at times ``(time,)``."""
    intervals = (times[1:] - times[:-1]).tolist()
    return sum(max(1, round_up(interval / system.dt)) for interval in intervals)


def takes_too_long(system: System, times: Tensor, budget: Budget) -> bool:
    """Return whether a program takes too long for a fit of one trajectory over the record.

    A system with axes has no other fit, whatever that takes.
    """
    if system.program is None or system.axes:
        return False
    seconds = SIMULATIONS * calls_per_simulation(system, times) * system.program.seconds
    return seconds > SHARE * budget.seconds


def ends_of(system: System, times: Tensor, budget: Budget) -> Mapping[str, float]:
    """Return the share of the whole time after which each stage ends."""
    if system.program is None or not takes_too_long(system, times, budget):
        return ENDS
    calls = FREE_LENGTH * calls_per_simulation(system, times)
    free = calls * system.program.seconds_of(FREE_RUNS) / budget.seconds
    before = ENDS[LAST_OF_SEARCH]
    latest = max(ENDS["draw figures"] - free, LEAST)
    return {
        stage: min(end, latest) if end <= before else end for stage, end in ENDS_OF_SEGMENTS.items()
    }


def begin_budget(config: Config) -> Budget:
    """Return the budget of a run that begins now."""
    return Budget.begin(budget_seconds(config))


def budget_seconds(config: Config) -> float:
    """Return the seconds that a run may take."""
    default = DEFAULT_SECONDS[len(config.system.axes)]
    return default if config.budget is None else config.budget
