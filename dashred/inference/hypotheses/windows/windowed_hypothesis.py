"""Hypotheses with a window: which candidates act, and where, when or in which states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.fitted_law import fitted_candidates
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.law_block import LawBlock, WindowedTerms
from dashred.physics.window import Shape

# Prior std of a window's log width.
LOG_WIDTH = 1.0


@dataclass(frozen=True)
class WindowGuess:
    """First guess of a window.

    Attributes:
        shape: kind of the window.
        values: first guess of its edges and log width, ``(edge,)``.
        spread: prior standard deviation of each, ``(edge,)``.
    """

    shape: Shape
    values: tuple[float, ...]
    spread: tuple[float, ...]


@dataclass(frozen=True)
class Hypothesis:
    """Candidates that act everywhere, and others that act within one window.

    Attributes:
        global_terms: indices of the candidates that act everywhere.
        windowed_terms: indices of those that act within the window.
        guess: first guess of the window; None without a window.
    """

    global_terms: tuple[int, ...] = ()
    windowed_terms: tuple[int, ...] = ()
    guess: WindowGuess | None = None

    @property
    def kind(self) -> str:
        """The kind of its window, or the number of candidates that act everywhere."""
        return self.guess.shape.kind if self.guess else f"{len(self.global_terms)} everywhere"

    def penalty(self, samples: float, candidates: int, windows: int) -> float:
        """Return the penalty for its degrees of freedom, without its priors.

        See docs/method.md#windows.

        Args:
            samples: n, the effective number of samples.
            candidates: p, the number of candidates.
            windows: number of window shapes that are tried.
        """
        n, p = math.log(samples), math.log(candidates)
        cost = len(self.global_terms) * (n + 2 * p)
        if self.guess is None:
            return cost
        cost += len(self.windowed_terms) * (n + 2 * p)
        edges = len(self.guess.values) - 1
        return cost + edges * n + 2 * math.log(windows)


@dataclass(frozen=True)
class HypothesisTrial:
    """A hypothesis after a fit of a few steps.

    Attributes:
        hypothesis: the hypothesis.
        objective: F, in its own unknowns.
        fitted: the fit.
        score: ``F + penalty``, lower is better.
    """

    hypothesis: Hypothesis
    objective: LeastSquaresProblem
    fitted: FitResult
    score: float

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Its candidates as terms, windows and all."""
        return fitted_candidates(self.objective, self.fitted.phi)


def build_problem(objective: LeastSquaresProblem, hypothesis: Hypothesis) -> LeastSquaresProblem:
    """Build the least-squares problem of a hypothesis.

    Args:
        objective: F of all candidates, acting everywhere.
        hypothesis: the hypothesis.
    """
    plain, guess = objective.subset(hypothesis.global_terms), hypothesis.guess
    if guess is None:
        return plain
    windowed = WindowedTerms(
        [objective.forward_model.law.candidates[j] for j in hypothesis.windowed_terms],
        guess.shape,
        torch.tensor(guess.values, dtype=torch.float64),
    )
    law = LawBlock(plain.forward_model.law.candidates, windowed)
    coefficients = objective.prior_std[list(hypothesis.windowed_terms)]
    edges = torch.tensor(guess.spread, dtype=torch.float64)
    return plain.with_unknowns(
        replace(plain.forward_model, law=law), torch.cat([coefficients, edges])
    )


def fit_trial(
    objective: LeastSquaresProblem,
    hypothesis: Hypothesis,
    phi: Tensor,
    steps: int,
    tolerance: float,
    penalty: float,
) -> HypothesisTrial:
    """Fit a hypothesis for some steps, beginning at ``phi``."""
    problem = build_problem(objective, hypothesis)
    fitted = minimise(problem, phi, steps, tolerance)
    return HypothesisTrial(hypothesis, problem, fitted, fitted.cost + penalty)


def first_unknowns(z: Tensor, coefficients: Sequence[float], guess: WindowGuess | None) -> Tensor:
    """Return the unknowns at which a fit begins, with the window at its first guess."""
    edges = len(guess.values) if guess else 0
    return torch.cat([z, torch.tensor([*coefficients, *[0.0] * edges], dtype=torch.float64)])
