"""Uncertain parameters as a block of unknowns: each has a normal prior.

The tendency changes by ``Σ_i (m_i + s_i z_i) ∂N/∂p_i`` with z_i ~ N(0, 1), the spread s_i, and m_i
the stated value less the value in the system, about which the tendency is linearised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from dashred.inference.forward.candidates import Candidate


@dataclass(frozen=True)
class ParameterBlock:
    """Uncertain parameters, which every fit adjusts.

    Attributes:
        candidates: the parameters as changes of the tendency, each with its prior.
    """

    candidates: tuple[Candidate, ...] = ()

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.candidates)

    @property
    def means(self) -> Tensor:
        """Prior mean of every change, ``(parameter,)``, in the user's units."""
        return self._priors[:, 0]

    @property
    def stds(self) -> Tensor:
        """Prior standard deviation of every change, ``(parameter,)``, in the user's units."""
        return self._priors[:, 1]

    @cached_property
    def _priors(self) -> Tensor:
        priors = [candidate.prior for candidate in self.candidates]
        return torch.tensor(priors, dtype=torch.float64).reshape(-1, 2)


NO_PARAMETERS = ParameterBlock()


def split_parameters(
    candidates: Sequence[Candidate],
) -> tuple[ParameterBlock, list[Candidate]]:
    """Return the uncertain parameters, and the candidates for what is missing."""
    uncertain = tuple(c for c in candidates if c.prior is not None)
    return ParameterBlock(uncertain), [c for c in candidates if c.prior is None]
