"""Everything an analysis has found out, as verification and the report read it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from dashred.inference.hypotheses.result import Discovery
from dashred.pipeline.assimilation import Assimilated
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import Nominal
from dashred.pipeline.training import Learned
from dashred.pipeline.trajectories import Trajectories


@dataclass(frozen=True)
class Analysis:
    """The results of the stages.

    Attributes:
        nominal: the simulator as it is.
        learned: SHRED on the simulation.
        found: SHRED and DA-SHRED on the recording.
        discovered: the law.
        free: free runs with and without it.
        relearned: SHRED on the corrected simulation.
        corrected_shred: what it reads from the recording, ``(time, field, *grid)``.
        corrected_shred_of_others: from the other fitted episodes.
    """

    nominal: Nominal
    learned: Learned
    found: Assimilated
    discovered: Discovery
    free: Trajectories
    relearned: Learned
    corrected_shred: Tensor
    corrected_shred_of_others: tuple[Tensor, ...] = ()

    def episodes(self, problem: Problem) -> list[tuple[Problem, Analysis]]:
        """Return every fitted episode with what was found out of it, the longest first."""
        found, free, simulated = self.found, self.free, self.nominal
        others = zip(
            problem.others,
            simulated.others,
            found.others,
            free.others,
            self.corrected_shred_of_others,
            strict=True,
        )
        return [
            (replace(problem, others=(), whole=()), self),
            *(
                (
                    episode,
                    replace(
                        self,
                        nominal=replace(simulated, states=states),
                        found=replace(found, shred=shred, dashred=dashred),
                        free=run,
                        corrected_shred=corrected,
                    ),
                )
                for episode, states, (shred, dashred), run, corrected in others
            ),
        ]

    def estimates(self, samples: int) -> dict[str, Tensor]:
        """Return the field by method over the first samples, ``(time, field, *grid)``."""
        found = {
            "simulation": self.nominal.states,
            **self.free.states,
            "shred": self.found.shred,
            "dashred": self.found.dashred,
            "corrected_shred": self.corrected_shred,
        }
        return {name: states[:samples] for name, states in found.items()}
