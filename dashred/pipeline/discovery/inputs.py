"""What the discovery along one trajectory is given."""

from __future__ import annotations

from dataclasses import dataclass

from dashred.inference.segments.selection.search import SegmentSearch
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline.networks.assimilation import AssimilationResult
from dashred.pipeline.networks.training import TrainedNetwork
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun


@dataclass(frozen=True)
class DiscoveryInputs:
    """The recording, the simulations, and the results of the stages before the discovery.

    Attributes:
        problem: recording and settings.
        nominal: simulation that gives the scales of the terms.
        resolution: numerical error of the simulation.
        ensemble: simulations from which first guesses are made.
        network: SHRED, with its errors on test members.
        assimilated: reconstructed fields and the terms that latent SINDy proposes.
        segments: laws found over segments, which are told if no trajectory reaches the end of the
            record and no other cause explains it; None if there are none.
    """

    problem: Problem
    nominal: NominalRun
    resolution: Resolution
    ensemble: Ensemble
    network: TrainedNetwork
    assimilated: AssimilationResult
    segments: SegmentSearch | None
