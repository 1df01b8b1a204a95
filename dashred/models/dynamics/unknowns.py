"""The unknowns of a fit over states, and its residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Unknowns:
    """A point of the minimisation.

    Attributes:
        states: c_t, POD coefficients of all samples in units of their std, ``(time, mode)``.
        law: ξ in units of the scales, ``(term,)``; zero outside of the law.
    """

    states: Float[Tensor, "time mode"]
    law: Float[Tensor, " term"]

    def moved(self, states: Tensor, law: Tensor, terms: Sequence[int]) -> Unknowns:
        """Return the point after a step of the states, and of the coefficients of some terms."""
        return Unknowns(
            self.states + states, self.law.index_add(0, torch.tensor(terms, dtype=torch.long), law)
        )


@dataclass(frozen=True)
class Residuals:
    """Residuals whose squares add up to the loss times the number of readings.

    Attributes:
        misfit: of the readings, ``(time, sensor)``; zero where one is missing.
        forecast_misfit: of the forecasts, in the row of the sample from which they start.
        step: of the steps, ``(time, mode)``, in the same row; zero at the end of an episode.
        background: ``(time, mode)``.
        start: of the first sample of an episode, ``(time, mode)``; zero at the others.
        law: ``(term,)``.
    """

    misfit: Tensor
    forecast_misfit: Tensor
    step: Tensor
    background: Tensor
    start: Tensor
    law: Tensor

    @property
    def cost(self) -> float:
        """Sum of all squares."""
        return sum(float(part.square().sum()) for part in vars(self).values())
