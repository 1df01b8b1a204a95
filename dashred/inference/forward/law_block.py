"""The law as a block of unknowns: coefficients of candidates, global or within a window.

The block adds ``Σ_i ξ_i θ_i(u) + χ(ψ₀ + δψ) Σ_j η_j θ_j(u)`` to the simulator's tendency. Its
unknowns are ξ, then η, then δψ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.forward.candidates import Candidate, build_forcing
from dashred.inference.forward.simulator import Simulator
from dashred.physics.expressions.algebra import Number, multiply
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import Term
from dashred.physics.window import Shape, Window

EDGE_STEP = 0.1


@dataclass(frozen=True)
class WindowedTerms:
    """Candidates that act within one window only.

    Attributes:
        candidates: candidates with coefficients η.
        shape: shape of the window.
        guess: ψ₀, first guess of the parameters of the window, ``(edge,)``.
    """

    candidates: Sequence[Candidate]
    shape: Shape
    guess: Tensor

    @property
    def count(self) -> int:
        """Number of unknowns η and δψ."""
        return len(self.candidates) + len(self.guess)

    def window(self, unknowns: Tensor) -> Window:
        """Return the window for one vector of unknowns ``(η, δψ)``."""
        return self.shape.at((self.guess + unknowns[len(self.candidates) :]).tolist())


@dataclass(frozen=True)
class LawBlock:
    """Candidates with unknown coefficients.

    Attributes:
        candidates: candidates with coefficients ξ; they act everywhere.
        windowed: further candidates within a window; None without a window.
    """

    candidates: Sequence[Candidate]
    windowed: WindowedTerms | None = None

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.candidates) + (self.windowed.count if self.windowed else 0)

    @property
    def scales(self) -> Tensor:
        """Natural scale of every unknown, ``(unknown,)``."""
        sizes = [candidate.scale for candidate in self.candidates]
        if self.windowed:
            sizes += [candidate.scale for candidate in self.windowed.candidates]
            sizes += [EDGE_STEP] * len(self.windowed.guess)
        return torch.tensor(sizes, dtype=torch.float64)

    def terms(self, unknowns: Tensor) -> tuple[Candidate, ...]:
        """Return the candidates of ξ and η; the terms of η contain the window as a factor."""
        if self.windowed is None:
            return tuple(self.candidates)
        window = self.windowed.window(unknowns[len(self.candidates) :])
        return (*self.candidates, *restrict_to_window(self.windowed.candidates, window))

    def weights(self, simulator: Simulator, unknowns: Tensor) -> Tensor:
        """Return the simulator's weights for rows of unknowns, ``(row, weight)``."""
        if self.windowed is None:
            return simulator.weights(self.candidates, unknowns)
        split, both = len(self.candidates), [*self.candidates, *self.windowed.candidates]
        coefficients = unknowns[:, : len(both)]
        inside = torch.arange(len(both)) >= split
        windows = [self.windowed.window(row[split:]) for row in unknowns]
        return simulator.weights(both, coefficients * ~inside, coefficients * inside, windows)

    def compiled_weights(self, simulator: Simulator, unknowns: Tensor) -> Tensor | None:
        """Return the weights of one vector of unknowns, ``(1, weight)``.

        They are None if the simulator has not compiled a candidate with a coefficient: one that is
        not its own, or one whose terms already contain a window.
        """
        count = len(self.candidates)
        kept = torch.nonzero(unknowns[:count]).flatten().tolist()
        active = replace(self, candidates=[self.candidates[j] for j in kept])
        local = self.windowed.candidates if self.windowed else ()
        if not simulator.has_compiled([*active.candidates, *local]):
            return None
        return active.weights(simulator, torch.cat([unknowns[kept], unknowns[count:]])[None])

    def forcing(self, unknowns: Tensor) -> Forcing:
        """Return the law for one vector of unknowns, without terms whose coefficient is 0."""
        terms = self.terms(unknowns)
        nonzero = torch.nonzero(unknowns[: len(terms)]).flatten().tolist()
        return build_forcing([terms[j] for j in nonzero], unknowns[None, nonzero])

    def sources(self, unknowns: Tensor) -> list[tuple[Term, ...]]:
        """Return the derivative of the tendency with respect to each unknown, as terms."""
        found = [candidate.effects for candidate in self.terms(unknowns)]
        if self.windowed is None:
            return found
        coefficients = unknowns[len(self.candidates) : len(found)].tolist()
        local = [*zip(self.windowed.candidates, coefficients, strict=True)]
        window = self.windowed.window(unknowns[len(self.candidates) :])
        return found + [
            tuple(
                Term(term.equation, multiply((slope, term.expression, Number(value))))
                for candidate, value in local
                for term in candidate.terms
            )
            for slope in window.slopes()
        ]


def restrict_to_window(candidates: Sequence[Candidate], window: Window) -> list[Candidate]:
    """Return candidates with the terms ``χ θ``, which act within a window only."""
    chi = window.expression
    return [
        replace(
            candidate,
            terms=tuple(Term(t.equation, multiply((chi, t.expression))) for t in candidate.terms),
            window=window,
        )
        for candidate in candidates
    ]
