"""Laws one step beyond the library, for recordings that no law of it explains.

See docs/method.md#extended-library.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.inference.fit.law import law_of
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.inference.hypotheses.extended.nonlinear_constants import (
    TunableTerm,
    build_slopes,
    fit_constant,
    next_constant,
    parse_tunable_term,
    solve_within_bounds,
)
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.windows.screening import profile_out
from dashred.inference.hypotheses.windows.windowed_hypothesis import Hypothesis
from dashred.physics.library import build_library
from dashred.physics.system import System, Term

# Terms that are fitted, of those that screen best.
MAX_FITS = 4
STEPS, TOLERANCE = 10, 1e-4


def build_extended_candidates(
    system: System, library: list[Term], nominal: Tensor, t: float | Tensor
) -> list[Candidate]:
    """Return terms that are like none of the library's: functions, higher powers, waves.

    Args:
        system: the simulator.
        library: the candidate terms of the analysis.
        nominal: states of the simulator, ``(time, field, *grid)``.
        t: time of all of them, or of each, ``(time,)``.
    """
    known = {str(term) for term in library}
    terms = []
    for equation in dict.fromkeys(term.equation for term in library):
        for text in _texts(system):
            try:
                [term] = build_library(system, {equation: [text]})
            except InputError:
                continue
            if str(term) not in known:
                terms.append(term)
    names = {f"{term.equation}: {term}" for term in terms}
    found = build_candidates(system, [*library, *terms], nominal, t)
    return [replace(c, extended=True) for c in found if str(c) in names]


@dataclass(frozen=True)
class _ExtendedLaw:
    """A law to be asked.

    Attributes:
        members: columns of the linearised problem: a term, a wave's two, or a term and its slope.
        family: of several that differ in a constant alone the best is fitted.
        tuned: a term whose constant is fitted; None for others.
    """

    members: tuple[int, ...]
    family: object
    tunable_term: TunableTerm | None = None

    def penalty(self, samples: float, candidates: int) -> float:
        """Return what its freedom costs; a constant, as much as an edge of a window."""
        if self.tunable_term is None:
            return Hypothesis(self.members).penalty(samples, candidates, 1)
        return Hypothesis(self.members[:1]).penalty(samples, candidates, 1) + math.log(samples)

    def screen(self, problem: ProfiledProblem) -> tuple[float, Tensor]:
        """Return F of the linearised problem, and the coefficients there."""
        if self.tunable_term is not None:
            return solve_within_bounds(problem, self.members, self.tunable_term.constant)
        [cost] = problem.costs([self.members]).tolist()
        return cost, problem.coefficients(self.members)


def fit_extended_laws(
    full_problem: LeastSquaresProblem,
    terms: Sequence[Candidate],
    forcing: FreeForcing,
    library: int,
    bound: float = math.inf,
) -> list[HypothesisFit]:
    """Return laws of one term from beyond the library, or of a wave whose phase is free.

    Where a function has a constant, it may be fitted.

    Args:
        everything: F over the whole record, of any terms.
        further: the terms from beyond the library.
        forced: a free forcing that explains the recording.
        library: how many candidates the library has: each more that is asked makes chance likelier.
        bound: what screens worse is not fitted.
    """
    columns, columns_and_slopes = list(terms), [*terms, *build_slopes(terms)]
    # In reach: what is fitted, and what the forcing's trajectory is run with.
    reach_problem = full_problem.of(
        [*columns_and_slopes, *forcing.objective.forward_model.law.candidates]
    )
    objective = reach_problem.only(range(len(columns)))
    problem = profile_out(
        objective, forcing, columns_and_slopes, reach_problem.prior_std[: len(columns_and_slopes)]
    )
    samples, count = objective.noise.effective_count, library + len(columns)
    ranked = []
    for law in _build_laws(columns):
        cost, coefficients = law.screen(problem)
        penalty = law.penalty(samples, count)
        if cost + penalty < bound:
            ranked.append((cost + penalty, penalty, law, coefficients))
    best_of_family: dict[object, tuple[float, _ExtendedLaw, Tensor]] = {}
    for _, penalty, law, coefficients in sorted(ranked, key=lambda each: each[0]):
        best_of_family.setdefault(law.family, (penalty, law, coefficients))
    return [
        _fit(objective, forcing, law, coefficients, penalty)
        for penalty, law, coefficients in list(best_of_family.values())[:MAX_FITS]
    ]


def _build_laws(columns: Sequence[Candidate]) -> list[_ExtendedLaw]:
    """Return the laws of one column, of a wave's two, and of a term and its slope."""
    inner = [parse_tunable_term(candidate) for candidate in columns]
    family = [found.family if found else j for j, found in enumerate(inner)]
    index_of_key = {
        candidate.key: j for j, candidate in enumerate([*columns, *build_slopes(columns)])
    }
    tunable_laws = [
        _ExtendedLaw((j, index_of_key[found.slope.key]), family[j], found)
        for j, found in enumerate(inner)
        if found
    ]
    wave_laws = [_ExtendedLaw(pair, pair) for pair in _waves(columns)]
    return [
        *(_ExtendedLaw((j,), family[j]) for j in range(len(columns))),
        *wave_laws,
        *tunable_laws,
    ]


def _fit(
    objective: LeastSquaresProblem,
    forcing: FreeForcing,
    law: _ExtendedLaw,
    coefficients: Tensor,
    penalty: float,
) -> HypothesisFit:
    start = forcing.phi[: objective.modes]
    if law.tunable_term is not None:
        xi, by_constant = coefficients.tolist()
        begin = law.tunable_term.at(next_constant(law.tunable_term, xi, by_constant))
        _, law_problem, fitted = fit_constant(
            objective, begin, torch.cat([start, coefficients[:1]])
        )
    else:
        law_problem = objective.of([objective.forward_model.law.candidates[j] for j in law.members])
        fitted = minimise(law_problem, torch.cat([start, coefficients]), STEPS, TOLERANCE)
    return HypothesisFit(
        law_of(law_problem, fitted, fitted.cost + penalty), law_problem, fitted.phi
    )


def _waves(candidates: Sequence[Candidate]) -> list[tuple[int, int]]:
    """Return the pairs of a sine and the same cosine: their sum is a wave of any phase."""
    index_of_key = {candidate.key: j for j, candidate in enumerate(candidates)}
    cosine_keys = {
        j: key.replace("sin(", "cos(") for key, j in index_of_key.items() if "sin(" in key
    }
    return [(j, index_of_key[key]) for j, key in cosine_keys.items() if key in index_of_key]


def _texts(system: System) -> Iterator[str]:
    """Yield functions of each field, higher powers, and waves along each axis."""
    for f in system.fields:
        yield from (f"{wave}({k}*{f})" for wave in ("sin", "cos") for k in (1, 2, 3))
        yield f"exp({f})"
        yield from (f"tanh({f})", f"tanh(3*{f})", f"exp(-{f})", f"exp(-{f}**2)")
        yield from (f"abs({f})", f"abs({f})*{f}", f"{f}**4", f"{f}**5")
    for axis in system.axes:
        turn = f"2*pi*{axis.name}/{axis.length!r}"
        yield from (f"sin({turn})", f"cos({turn})")
        yield from (f"{f}*{wave}({turn})" for f in system.fields for wave in ("sin", "cos"))
