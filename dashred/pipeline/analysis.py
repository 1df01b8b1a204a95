"""The results of all stages of an analysis, as verification and the report read them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from dashred.inference.hypotheses.result import Discovery
from dashred.pipeline.networks.assimilation import AssimilationResult
from dashred.pipeline.networks.training import TrainedNetwork
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.trajectories import Trajectories


@dataclass(frozen=True)
class Analysis:
    """The results of the stages.

    Attributes:
        nominal: simulation from the nominal start, without corrections.
        network: SHRED, trained on the simulation.
        assimilated: SHRED and DA-SHRED on the recording.
        discovery: the law and its alternatives.
        trajectories: free runs with and without the law.
        corrected_network: SHRED, trained on the corrected simulation.
        corrected_shred: field that it reconstructs from the recording, ``(time, field, *grid)``.
        corrected_shred_of_others: the same for the other fitted episodes.
        observed: estimate of the observer and its standard deviation, ``(time, field, *grid)``
            both; None without an observer.
        observed_of_others: the same for the other fitted episodes.
    """

    nominal: NominalRun
    network: TrainedNetwork
    assimilated: AssimilationResult
    discovery: Discovery
    trajectories: Trajectories
    corrected_network: TrainedNetwork
    corrected_shred: Tensor
    corrected_shred_of_others: tuple[Tensor, ...] = ()
    observed: tuple[Tensor, Tensor] | None = None
    observed_of_others: tuple[tuple[Tensor, Tensor], ...] = ()

    def episodes(self, problem: Problem) -> list[tuple[Problem, Analysis]]:
        """Return each fitted episode with its results; the longest episode is first."""
        others = zip(
            problem.others,
            self.nominal.others,
            self.assimilated.others,
            self.trajectories.others,
            self.corrected_shred_of_others,
            self.observed_of_others or (None,) * len(problem.others),
            strict=True,
        )
        return [
            (replace(problem, others=(), whole=()), self),
            *(
                (
                    episode,
                    replace(
                        self,
                        nominal=replace(self.nominal, states=states),
                        assimilated=replace(self.assimilated, shred=shred, dashred=dashred),
                        trajectories=runs,
                        corrected_shred=corrected,
                        observed=observed,
                    ),
                )
                for episode, states, (shred, dashred), runs, corrected, observed in others
            ),
        ]

    def estimates(self, samples: int) -> dict[str, Tensor]:
        """Return the field by method over the first samples, ``(time, field, *grid)``."""
        fields = {
            "simulation": self.nominal.states,
            **self.trajectories.states,
            "shred": self.assimilated.shred,
            "dashred": self.assimilated.dashred,
            "corrected_shred": self.corrected_shred,
        }
        if self.observed is not None:
            fields["observer"] = self.observed[0]
        return {name: states[:samples] for name, states in fields.items()}
