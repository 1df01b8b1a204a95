"""Shooting with terms that act somewhere, from some time on, or in some states only."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.forward.candidates import Candidate, forcing_of
from dashred.inference.forward.forward_model import ForwardModel
from dashred.physics.expressions.algebra import Number, multiply
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.system import Term
from dashred.physics.window import Shape, Window

EDGE_STEP = 0.1


@dataclass(frozen=True)
class WindowedModel(ForwardModel):
    """``(z, ξ, ψ) → H S(u₀(z); N + Σ_everywhere ξ θ + χ(ψ) Σ_inside ξ θ)``.

    Its coefficients are those of the candidates everywhere, then inside, then how far the
    window's unknowns are from where they are guessed to be.

    Attributes:
        inside: candidates that act within the window alone.
        shape: of the window.
        guess: of ψ, ``(unknown,)``.
    """

    inside: Sequence[Candidate]
    shape: Shape
    guess: Tensor

    def window(self, xi: Tensor) -> Window:
        """Return the window of one vector of coefficients."""
        edges = self.guess + xi[len(self.candidates) + len(self.inside) :]
        return self.shape.at(edges.tolist())

    def states(
        self, z: Tensor, xi: Tensor, sampled_forcing: SampledForcing | None = None
    ) -> Tensor:
        """Return the trajectories ``(batch, time, field, *grid)``, under a free forcing."""
        split = len(self.candidates)
        both = [*self.candidates, *self.inside]
        everywhere = torch.zeros((len(xi), len(both)), dtype=torch.float64)
        everywhere[:, :split] = xi[:, :split]
        inside = torch.zeros_like(everywhere)
        inside[:, split:] = xi[:, split : len(both)]
        windows = [self.window(row) for row in xi]
        return self.simulator.run_local(
            self.start.start(z), self.times, both, everywhere, inside, windows, sampled_forcing
        )

    def tangents(
        self,
        start: Tensor,
        directions: Tensor,
        xi: Tensor,
        sampled_forcing: SampledForcing | None = None,
        forcing_basis: ForcingBasis | None = None,
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield state and tangents at every sample: of the directions, ξ, ψ, and pulses."""
        window, split = self.window(xi), len(self.candidates)
        local = localised(self.inside, window)
        both = [*self.candidates, *local]
        coefficients = xi[: len(both)]
        sources = [candidate.terms for candidate in both]
        sources += [
            tuple(
                Term(t.equation, multiply((slope, t.expression, Number(value))))
                for candidate, value in zip(self.inside, coefficients[split:].tolist(), strict=True)
                for t in candidate.terms
            )
            for slope in window.slopes()
        ]
        forcing = forcing_of(both, coefficients[None])
        return self.simulator.tangents(
            start, directions, self.times, forcing, sources, sampled_forcing, forcing_basis
        )

    @property
    def scales(self) -> Tensor:
        """A size of every coefficient that makes a difference."""
        sizes = [c.scale for c in (*self.candidates, *self.inside)]
        return torch.tensor(sizes + [EDGE_STEP] * len(self.guess), dtype=torch.float64)


def found_by(objective: LeastSquaresProblem, phi: Tensor) -> tuple[Candidate, ...]:
    """Return the candidates of a fit as terms, those in a window with its edges."""
    return as_terms(objective.forward_model, objective.split(phi)[1])


def as_terms(forward_model: ForwardModel, xi: Tensor) -> tuple[Candidate, ...]:
    """Return what a law's first coefficients multiply, those in a window with its edges."""
    if not isinstance(forward_model, WindowedModel):
        return tuple(forward_model.candidates)
    return (*forward_model.candidates, *localised(forward_model.inside, forward_model.window(xi)))


def localised(candidates: Sequence[Candidate], window: Window) -> list[Candidate]:
    """Return candidates that act within a window alone: ``χ θ`` is a term like any other."""
    chi = window.expression
    return [
        replace(
            candidate,
            terms=tuple(Term(t.equation, multiply((chi, t.expression))) for t in candidate.terms),
            window=window,
        )
        for candidate in candidates
    ]
