"""PDE-FIND on the full noisy field."""

from __future__ import annotations

import numpy as np
import torch

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.comparison.pde_find import pde_find
from dashred.evaluation.foreign.peers.full_state import FullState


def full_field_pde_find(full: FullState) -> list[TermEntry]:
    """Return the law of PDE-FIND; the method adds the noise and removes what it can of it."""
    rng = np.random.default_rng([full.seed, *b"full"])
    times, states = torch.from_numpy(full.times), torch.from_numpy(full.states)
    return pde_find(full.system, full.library, times, states, full.noise, rng)
