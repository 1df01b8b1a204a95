"""Both networks of a problem, and a run that stores what is logged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dashred.core.tracking import NullTracker
from dashred.pipeline.networks.assimilation import AssimilationResult, assimilate
from dashred.pipeline.networks.training import TrainedNetwork, train_shred
from dashred.pipeline.simulation_runs import SimulationRuns


class Logged(NullTracker):
    """A run that stores the logged points, those of its stages among them."""

    def __init__(self) -> None:
        self.points: list[tuple[int, dict[str, float]]] = []

    def log_metrics(self, metrics: Mapping[str, float], step: int) -> None:
        """Store the metrics."""
        self.points.append((step, dict(metrics)))


@dataclass(frozen=True)
class Networks:
    """SHRED and its assimilation, and the logged points."""

    shred: TrainedNetwork
    assimilated: AssimilationResult
    log: list[tuple[int, dict[str, float]]]


def fit_networks(simulated: SimulationRuns) -> Networks:
    """Train SHRED on the ensemble and assimilate the recording."""
    problem, run = simulated.problem, Logged()
    assert simulated.ensemble is not None
    network = train_shred(problem, simulated.ensemble, run, {}, "SHRED")
    assimilated = assimilate(problem, simulated.nominal, network, run, {})
    return Networks(network, assimilated, run.points)
