"""The simulator from each sample to the next, with a law that is learnt beside the network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.sample_step import SampleStep
from dashred.physics.system import Term

# Values of all states that are stepped together. The graph of a step holds some hundred arrays of
# this size, a gigabyte in all.
VALUES_AT_ONCE = 2**16


@dataclass(frozen=True)
class EpisodeSteps:
    """The steps of one episode.

    Attributes:
        step: Φ over one sample, with the inputs of the episode.
        times: of its samples, ``(time,)``.
        first: row of its first sample among the samples of all episodes.
    """

    step: SampleStep
    times: Tensor
    first: int


@dataclass(frozen=True)
class Samples:
    """Consecutive samples of one episode.

    Attributes:
        episode: the episode.
        rows: of the samples, among those of all episodes.
        begins: times of all samples but the last, ``(time - 1,)``.
        durations: times until the next, ``(time - 1,)``.
        is_last: whether the last sample is that of the episode.
    """

    episode: EpisodeSteps
    rows: slice
    begins: Tensor
    durations: Tensor
    is_last: bool


class SampledDynamics(nn.Module):
    """``Φ_Δ(u_t; ξ)`` for all samples t that have a next one.

    Args:
        episodes: of the recording.
        terms: tendency per unit of each coefficient, resolved: a candidate term θ, or the terms
            ∂N/∂p of a parameter.
        scales: coefficients at which each would be as large as the tendency, ``(term,)``.
        spread: std of each field, which makes errors of fields comparable, ``(field,)``.
        cells: values of a state.

    Attributes:
        law: ξ in units of the scales, ``(term,)``, float64.
        support: which terms the law has, ``(term,)``.
    """

    scales: Tensor
    spread: Tensor
    support: Tensor

    def __init__(
        self,
        episodes: Sequence[EpisodeSteps],
        terms: Sequence[tuple[Term, ...]],
        scales: Tensor,
        spread: Tensor,
        cells: int,
    ) -> None:
        super().__init__()
        self.episodes, self.terms = tuple(episodes), tuple(terms)
        self.at_once = max(1, VALUES_AT_ONCE // cells)
        self.law = nn.Parameter(torch.zeros(len(terms), dtype=torch.float64))
        self.register_buffer("scales", scales.double())
        self.register_buffer("spread", spread.double())
        self.register_buffer("support", torch.zeros(len(terms), dtype=torch.bool))

    @property
    def coefficients(self) -> Float[Tensor, " term"]:
        """ξ in the units of the terms; zero outside of the support."""
        return torch.where(self.support, self.law * self.scales, 0.0)

    @torch.no_grad()
    def set_law(self, coefficients: Float[Tensor, " term"]) -> None:
        """Take other coefficients; those that are not zero are the support."""
        self.law.copy_(coefficients / self.scales)
        self.support.copy_(coefficients != 0)

    def blocks(self) -> Iterator[Samples]:
        """Yield all steps in blocks of consecutive samples; neighbours share a sample."""
        for episode in self.episodes:
            count = len(episode.times)
            for begin in range(0, count - 1, self.at_once):
                end = min(begin + self.at_once, count - 1)
                rows = slice(episode.first + begin, episode.first + end + 1)
                times = episode.times[begin : end + 1]
                yield Samples(episode, rows, times[:-1], times.diff(), end == count - 1)

    def advance(
        self, samples: Samples, states: Float[Tensor, "time ..."]
    ) -> Float[Tensor, "time ..."]:
        """Return the forecast of each state, float64.

        Args:
            samples: of a block.
            states: at all its samples but the last, ``(time - 1, field, *grid)``.
        """
        on = self.support.nonzero()[:, 0].tolist()
        forcing = None
        if on:
            owner = [j for j in on for _ in self.terms[j]]
            added = tuple(term for j in on for term in self.terms[j])
            forcing = Forcing(added, self.coefficients[None, owner])
        begins, durations = samples.begins, samples.durations
        return samples.episode.step(states.double(), begins, durations, forcing)

    @torch.no_grad()
    def forecasts(self, fields: Float[Tensor, "time ..."]) -> Float[Tensor, "time ..."]:
        """Return the forecast of each sample from the one before, float64.

        The first sample of an episode has none, and stays as it is.
        """
        found = fields.double().clone()
        for block in self.blocks():
            rows = slice(block.rows.start + 1, block.rows.stop)
            found[rows] = self.advance(block, fields[block.rows][:-1])
        return found

    def scaled(self, fields: Float[Tensor, "time ..."]) -> Float[Tensor, "time ..."]:
        """Return fields in units of the std of each."""
        return fields / self.spread.reshape(-1, *(1,) * (fields.dim() - 2))
