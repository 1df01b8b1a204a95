"""Everything an analysis has found out, as verification and the report read it."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from dashred.discovery.discovered import Discovered
from dashred.stages.assimilation import Assimilated
from dashred.stages.learning import Learned
from dashred.stages.simulation import Nominal
from dashred.stages.trajectories import Trajectories


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
    """

    nominal: Nominal
    learned: Learned
    found: Assimilated
    discovered: Discovered
    free: Trajectories
    relearned: Learned
    corrected_shred: Tensor

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
