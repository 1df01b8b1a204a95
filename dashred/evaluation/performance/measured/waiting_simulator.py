"""A simulator whose columns take time, but no processor."""

from __future__ import annotations

import time
from collections.abc import Sequence

import torch
from torch import Tensor

from dashred.inference.forward.simulator import ALL, Samples, Simulator
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import Term


class WaitingSimulator(Simulator):
    """Waits as long as columns would take, and returns zeros.

    More workers than cores can wait at once. What is left of the seconds is what it costs to divide
    the columns among them.

    Args:
        simulator: whose shapes the columns have.
        trajectory: seconds of the trajectory, which each worker integrates.
        column: seconds of a column.
    """

    def __init__(self, simulator: Simulator, trajectory: float, column: float) -> None:
        super().__init__(simulator.parts, simulator.parameters)
        self.trajectory, self.column = trajectory, column

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        times: Tensor,
        forcing: Forcing,
        sources: Sequence[tuple[Term, ...]],
        sampled_forcing: SampledForcing | None,
        forcing_basis: ForcingBasis | None,
        weights: Tensor | None,
        chosen: slice = ALL,
    ) -> Samples:
        """Wait, then yield zeros at all samples; see :meth:`.Simulator.tangents`."""
        others = forcing_basis.count if forcing_basis else 0
        wanted = len(range(len(directions) + len(sources) + others)[chosen])
        time.sleep(self.trajectory + wanted * self.column)
        shape = start.shape
        yield torch.zeros((len(times), *shape)), torch.zeros((len(times), wanted, *shape))
