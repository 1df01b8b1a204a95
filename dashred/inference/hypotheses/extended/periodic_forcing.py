"""A forcing that is uniform in space and periodic in time: ``a sin(ωt) + b cos(ωt)``.

A free forcing has a dozen knots in time and cannot represent anything faster. A uniform forcing
needs only one cell and may therefore have many knots. The columns of every frequency are linear
combinations of the columns of these knots. The best waves are fitted, including their frequency.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.budget import in_time
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.hypotheses.hypothesis_fit import UNLIKELY, HypothesisFit
from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.system import System
from dashred.physics.terms.library import build_library, equations_with_candidates, resolve

# Knots in time, and the smallest number of knots in a period: the forcing is linear between knots.
KNOTS, KNOTS_PER_PERIOD = 64, 2.5
# Step between frequencies, in periods over the record.
FREQUENCY_STEP = 0.05
# A wave has to explain this share of the misfit beyond noise. Otherwise the linearisation is poor.
MIN_EXPLAINED_SHARE = 0.5
# Number of waves that are fitted; waves of similar frequency in one equation count as one.
MAX_FITS = 3
# Rounds of fitting the frequency, the phase shift at the ends of the record at convergence, and the
# digits of the frequency.
ROUNDS, CONVERGED_PHASE, DIGITS = 6, 0.1, 4
STEPS, TOLERANCE = 4, 1e-3
LAST_STEPS, LAST_TOLERANCE = 10, 1e-4


@dataclass(frozen=True)
class Wave:
    """``a sin(ωt) + b cos(ωt)`` in an equation.

    Attributes:
        equation: the field whose equation contains the wave.
        frequency: ω, radians per unit time.
        sine: a.
        cosine: b.
    """

    equation: str
    frequency: float
    sine: float
    cosine: float

    def at(self, frequency: float, middle: float) -> Wave:
        """Return the wave with another frequency that agrees with this one at a given time."""
        turn = (frequency - self.frequency) * middle
        sine = self.sine * math.cos(turn) + self.cosine * math.sin(turn)
        cosine = self.cosine * math.cos(turn) - self.sine * math.sin(turn)
        return Wave(self.equation, float(f"{frequency:.{DIGITS}g}"), sine, cosine)

    def is_close_to(self, other: Wave, turn: float) -> bool:
        """Tell whether two waves of one equation differ in frequency by no more than ``turn``."""
        return self.equation == other.equation and abs(self.frequency - other.frequency) <= turn

    @property
    def texts(self) -> list[str]:
        """Its two terms in the notation of the configuration."""
        return [f"sin({self.frequency!r}*t)", f"cos({self.frequency!r}*t)"]

    def slope(self, middle: float) -> str:
        """Return its derivative by the frequency at a fixed phase in the middle of the record."""
        sine, cosine = self.texts
        return f"(t - ({middle!r}))*(({self.sine!r})*{cosine} - ({self.cosine!r})*{sine})"


def fit_periodic_laws(
    base: HypothesisFit, tendency_rms: Tensor, candidate_count: int, bound: float = math.inf
) -> list[HypothesisFit]:
    """Fit a periodic forcing on top of a law, if the linearised problem favours one.

    Args:
        base: the fit of a law that acts everywhere, or of the uncorrected simulator.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.
        candidate_count: number of terms tried before, for the penalty of the search.
        bound: waves with a worse predicted score are not fitted.
    """
    objective = base.objective
    system, times = objective.forward_model.simulator.system, objective.forward_model.times
    forcing_basis = ForcingBasis.over(system, times, 1, KNOTS)
    block = ForcingBlock(forcing_basis, tendency_rms)
    forced_problem = objective.with_unknowns(
        replace(objective.forward_model, forcing=block), block.scales
    )
    normal = forced_problem.linearise(torch.cat([base.phi, torch.zeros_like(block.scales)]))
    grid = _frequency_grid(times)
    # Frequencies that differ by less than one period over the record cannot be distinguished.
    choices = candidate_count + len(system.fields) * len(grid) * FREQUENCY_STEP
    penalty = 3 * math.log(objective.noise.effective_count) + 2 * math.log(choices) + UNLIKELY
    required_change = min(bound - base.law.score, 0.0) - penalty
    excess = float(normal.residuals.square().sum()) - objective.noise.count
    required_change = min(required_change, -MIN_EXPLAINED_SHARE * excess)
    waves = _select_waves(normal, system, forcing_basis, grid, tendency_rms, required_change)
    fits = in_time(lambda wave: _fit_wave(base, wave, tendency_rms, penalty), waves)
    return [fit for fit in fits if fit is not None]


def _frequency_grid(times: Tensor) -> Tensor:
    """Return ω from one period over the record to the fastest that knots and samples resolve."""
    samples = max(len(column.unique()) for column in times.reshape(len(times), -1).T)
    most = min(KNOTS / KNOTS_PER_PERIOD, (samples - 1) / 2)
    turns = torch.arange(1.0, most, FREQUENCY_STEP, dtype=torch.float64)
    return 2 * math.pi * turns / float(times.max() - times.min())


def _select_waves(
    normal: NormalEquations,
    system: System,
    forcing_basis: ForcingBasis,
    grid: Tensor,
    tendency_rms: Tensor,
    required_change: float,
) -> list[Wave]:
    """Return the waves that decrease F enough on the linearised problem, the best first.

    An equation that only defines a rate, such as ``x' = v``, gets no forcing.
    """
    fields, knots = system.fields, forcing_basis.knots
    driven = [fields.index(field) for field in equations_with_candidates(system)]
    own = len(normal.phi) - forcing_basis.count
    angle = grid[:, None] * knots
    waves = torch.stack([angle.sin(), angle.cos()], dim=1)
    by_knot = normal.jacobian[:, own:].reshape(-1, len(fields), KNOTS)
    columns = torch.einsum("nek,wpk->newp", by_knot, waves).flatten(1)
    priors = tendency_rms.repeat_interleave(2 * len(grid)) ** -2 / 2
    linear = NormalEquations(
        torch.cat([normal.jacobian[:, :own], columns], dim=1),
        torch.cat([normal.precision[:own], priors]),
        torch.cat([normal.phi[:own], torch.zeros(len(priors), dtype=torch.float64)]),
        normal.residuals,
    )
    problem = ProfiledProblem.from_normal_equations(linear, own)
    choices = [e * len(grid) + j for e in driven for j in range(len(grid))]
    pairs = [(2 * choice, 2 * choice + 1) for choice in choices]
    costs = problem.costs(pairs)
    selected: list[Wave] = []
    for j in costs.argsort().tolist():
        equation, turn = divmod(choices[j], len(grid))
        wave = Wave(fields[equation], float(grid[turn]), *problem.coefficients(pairs[j]).tolist())
        if len(selected) == MAX_FITS or float(costs[j]) >= problem.constant + required_change:
            break
        if not any(wave.is_close_to(other, turn=float(grid[0])) for other in selected):
            selected.append(wave)
    return selected


def _fit_wave(
    base: HypothesisFit, wave: Wave, tendency_rms: Tensor, penalty: float
) -> HypothesisFit | None:
    """Fit a wave and its frequency together with the base law and the initial state.

    Below one period over the record, a wave is only a trend: None.
    """
    times = base.objective.forward_model.times
    first, last = float(times.min()), float(times.max())
    middle, half = (first + last) / 2, (last - first) / 2
    slowest, fastest = math.pi / half, float(_frequency_grid(times)[-1])
    own, phi, is_trend = len(base.phi), base.phi, False
    for _ in range(ROUNDS):
        slope = _build_slope(base, wave, middle, half)
        problem = _add_candidates(base, [*_build_wave_terms(base, wave, tendency_rms), slope])
        begin = torch.tensor([wave.sine, wave.cosine, 0.0], dtype=torch.float64)
        fitted = minimise(problem, torch.cat([phi, begin]), STEPS, TOLERANCE)
        phi = fitted.phi[:own]
        sine, cosine, shift = fitted.phi[own:].tolist()
        moved = wave.frequency + min(max(shift, -math.pi / half), math.pi / half)
        is_trend = moved < slowest
        frequency = min(max(moved, slowest), fastest)
        wave = replace(wave, sine=sine, cosine=cosine).at(frequency, middle)
        if abs(shift) * half < CONVERGED_PHASE:
            break
    if is_trend:
        return None
    problem = _add_candidates(base, _build_wave_terms(base, wave, tendency_rms))
    begin = torch.tensor([wave.sine, wave.cosine], dtype=torch.float64)
    fitted = minimise(problem, torch.cat([phi, begin]), LAST_STEPS, LAST_TOLERANCE)
    [before], _ = base.objective.values(base.phi[None])
    score = base.law.score - float(before) + fitted.cost + penalty
    return HypothesisFit(build_law(problem, fitted, score), problem, fitted.phi)


def _build_wave_terms(base: HypothesisFit, wave: Wave, tendency_rms: Tensor) -> list[Candidate]:
    system = base.objective.forward_model.simulator.system
    scale = math.sqrt(2) * float(tendency_rms[system.fields.index(wave.equation)])
    return list(_build_candidates(system, wave.equation, wave.texts, scale))


def _build_slope(base: HypothesisFit, wave: Wave, middle: float, half: float) -> Candidate:
    system = base.objective.forward_model.simulator.system
    [slope] = _build_candidates(system, wave.equation, [wave.slope(middle)], 1 / half)
    return slope


def _build_candidates(
    system: System, equation: str, texts: Sequence[str], scale: float
) -> Iterator[Candidate]:
    terms = build_library(system, {equation: list(texts)})
    for term, resolved in zip(terms, resolve(system, terms), strict=True):
        yield Candidate(str(term), equation, (resolved,), scale, is_extended=True)


def _add_candidates(base: HypothesisFit, candidates: Sequence[Candidate]) -> LeastSquaresProblem:
    """Return F of the base law and further candidates, with their natural scales as prior."""
    objective = base.objective
    base_candidates = base.law.candidates
    extended = objective.with_candidates([*base_candidates, *candidates])
    prior = torch.cat([objective.prior_std, extended.prior_std[len(base_candidates) :]])
    return replace(extended, prior_std=prior)
