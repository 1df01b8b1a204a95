"""Simulate an ensemble, train SHRED on it, and print the largest memory of this process.

Run by ``test_peak_memory.py`` in a process of its own: ``peak_memory.py CONFIG WORD...``.
"""

from __future__ import annotations

import json
import resource
import sys

from torch import Tensor

from dashred.config import load_config
from dashred.core.progress import Silent, shown_on
from dashred.core.tracking import NullTracker
from dashred.models.torch_setup import set_up_torch
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.networks.training import train_shred
from dashred.pipeline.simulation.ensemble_memory import memory_of
from dashred.pipeline.simulation.ensembles import simulate_ensemble
from dashred.pipeline.simulation.nominal_run import simulate_nominal


def main() -> None:
    """Print the largest memory, the planned one, both in bytes, and the error of the network."""
    set_up_torch(1)
    problem = build_problem(load_config([f"conf={sys.argv[1]}", *sys.argv[2:]], entry="test"))
    plan = memory_of(problem)
    with problem.scratch.removed_at_the_end(), shown_on(Silent()):
        ensemble = simulate_ensemble(problem, simulate_nominal(problem, {}), {})
        network = train_shred(problem, ensemble, NullTracker(), {}, "SHRED")
    found = {
        "peak": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "planned": plan.peak,
        "ensemble": plan.ensemble,
        "in_memory": isinstance(ensemble.states, Tensor),
        "error": network.test_rmse["all"],
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
