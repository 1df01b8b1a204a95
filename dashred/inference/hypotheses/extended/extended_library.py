"""Laws with a term beyond the library, for recordings that no law of the library explains.

See docs/method.md#extended-library.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.core.budget import in_time
from dashred.core.errors import InputError
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.selection.subset_search import ProfiledProblem
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
from dashred.inference.hypotheses.hypothesis_fit import UNLIKELY, HypothesisFit
from dashred.inference.hypotheses.windows.screening import profile_out
from dashred.inference.hypotheses.windows.windowed_hypothesis import Hypothesis
from dashred.physics.system import System, Term
from dashred.physics.terms.library import build_library

# Number of laws that are fitted, the best screened first.
MAX_FITS = 4
STEPS, TOLERANCE = 10, 1e-4


def build_extended_candidates(
    system: System, library: list[Term], nominal: Tensor, t: float | Tensor
) -> list[Candidate]:
    """Return candidates that the library does not contain: functions, higher powers, waves.

    Args:
        system: the simulator.
        library: the candidate terms of the analysis.
        nominal: states of the simulator, ``(time, field, *grid)``.
        t: the time of all states, or of each state, ``(time,)``.
    """
    terms = extended_terms(system, library)
    candidates = build_candidates(system, [*library, *terms], nominal, t, terms)
    return [candidate for candidate in candidates if candidate.is_extended]


def extended_terms(system: System, library: Sequence[Term]) -> list[Term]:
    """Return the terms one step beyond a library, in the equations that it covers.

    Friction, drag and saturation come first: a wave or an exponential is told only if none of
    these explains the recording as well.

    Args:
        system: the simulator.
        library: the candidate terms of the analysis.
    """
    known = {(term.equation, str(term)) for term in library}
    terms = []
    for equation in dict.fromkeys(term.equation for term in library):
        for text in _extended_texts(system):
            try:
                [term] = build_library(system, {equation: [text]})
            except InputError:
                continue
            if (equation, str(term)) not in known:
                known.add((equation, str(term)))
                terms.append(term)
    return terms


@dataclass(frozen=True)
class _ExtendedLaw:
    """A law to be screened.

    Attributes:
        members: columns of the linearised problem: one term, the sine and cosine of a wave, or a
            term and its slope.
        family: key of laws that differ only in a constant. Only the best of a family is fitted.
        tunable_term: the term whose constant is fitted; None for other laws.
    """

    members: tuple[int, ...]
    family: object
    tunable_term: TunableTerm | None = None

    def penalty(self, samples: float, candidates: int) -> float:
        """Return the penalty for its degrees of freedom; a constant costs ``ln n``."""
        constants = 0 if self.tunable_term is None else 1
        members = self.members[: len(self.members) - constants]
        of_terms = Hypothesis(members).penalty(samples, candidates, 1)
        return of_terms + constants * math.log(samples) + UNLIKELY

    def screen(self, problem: ProfiledProblem) -> tuple[float, Tensor]:
        """Return the minimum of F on the linearised problem, and its coefficients."""
        if self.tunable_term is not None:
            return solve_within_bounds(problem, self.members, self.tunable_term.constant)
        [cost] = problem.costs([self.members]).tolist()
        return cost, problem.coefficients(self.members)


def fit_extended_laws(
    full_problem: LeastSquaresProblem,
    candidates: Sequence[Candidate],
    forcing: FreeForcing,
    library_size: int,
    bound: float = math.inf,
) -> list[HypothesisFit]:
    """Fit laws of one term beyond the library, or of a wave with a free phase.

    The constant of a function may be fitted as well.

    Args:
        full_problem: F over the whole record, of any terms.
        candidates: the candidates beyond the library.
        forcing: a free forcing that explains the recording.
        library_size: number of candidates of the library, for the penalty of the search.
        bound: laws with a worse screening score are not fitted.
    """
    columns, columns_and_slopes = list(candidates), [*candidates, *build_slopes(candidates)]
    # The simulator needs the terms that are fitted and those of the law under the forcing.
    whole_problem = full_problem.with_candidates(
        [*columns_and_slopes, *forcing.objective.forward_model.law.candidates]
    )
    objective = whole_problem.subset(range(len(columns)))
    stds = whole_problem.prior_std[: len(columns_and_slopes)]
    problem = profile_out(objective, forcing, columns_and_slopes, stds)
    samples, count = objective.noise.effective_count, library_size + len(columns)
    ranked = []
    for law in _build_laws(columns):
        cost, coefficients = law.screen(problem)
        penalty = law.penalty(samples, count)
        if cost + penalty < bound:
            ranked.append((cost + penalty, penalty, law, coefficients))
    best_of_family: dict[object, tuple[float, _ExtendedLaw, Tensor]] = {}
    for _, penalty, law, coefficients in sorted(ranked, key=lambda each: each[0]):
        best_of_family.setdefault(law.family, (penalty, law, coefficients))

    def fit(screened: tuple[float, _ExtendedLaw, Tensor]) -> HypothesisFit:
        penalty, law, coefficients = screened
        return _fit(objective, forcing, law, coefficients, penalty)

    return in_time(fit, list(best_of_family.values())[:MAX_FITS])


def _build_laws(columns: Sequence[Candidate]) -> list[_ExtendedLaw]:
    """Return the laws of one term, of a wave, and of a term and its slope."""
    tunable_terms = [parse_tunable_term(candidate) for candidate in columns]
    family = [term.family if term else j for j, term in enumerate(tunable_terms)]
    index_of_key = {
        candidate.key: j for j, candidate in enumerate([*columns, *build_slopes(columns)])
    }
    tunable_laws = [
        _ExtendedLaw((j, index_of_key[term.slope.key]), family[j], term)
        for j, term in enumerate(tunable_terms)
        if term
    ]
    wave_laws = [_ExtendedLaw(pair, pair) for pair in _wave_pairs(columns)]
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
        xi, xi_k = coefficients.tolist()
        begin = law.tunable_term.at(next_constant(law.tunable_term, xi, xi_k))
        _, law_problem, fitted = fit_constant(
            objective, begin, torch.cat([start, coefficients[:1]])
        )
    else:
        law_problem = objective.with_candidates(
            [objective.forward_model.law.candidates[j] for j in law.members]
        )
        fitted = minimise(law_problem, torch.cat([start, coefficients]), STEPS, TOLERANCE)
    fitted_law = build_law(law_problem, fitted, fitted.cost + penalty)
    return HypothesisFit(fitted_law, law_problem, fitted.phi)


def _wave_pairs(candidates: Sequence[Candidate]) -> list[tuple[int, int]]:
    """Return the pairs of a sine and the same cosine. Their sum is a wave of any phase."""
    index_of_key = {candidate.key: j for j, candidate in enumerate(candidates)}
    cosine_keys = {
        j: key.replace("sin(", "cos(") for key, j in index_of_key.items() if "sin(" in key
    }
    return [(j, index_of_key[key]) for j, key in cosine_keys.items() if key in index_of_key]


def _extended_texts(system: System) -> Iterator[str]:
    """Yield functions of each field, higher powers, and waves along each axis."""
    for f in system.fields:
        yield from (f"sign({f})", f"abs({f})*{f}", f"sqrt(abs({f}))*sign({f})")
        yield from (f"{name}*{f}" for name in system.measured_inputs)
    for f in system.fields:
        yield from (f"{wave}({k}*{f})" for wave in ("sin", "cos") for k in (1, 2, 3))
        yield f"exp({f})"
        yield from (f"tanh({f})", f"tanh(3*{f})", f"exp(-{f})", f"exp(-{f}**2)")
        yield from (f"abs({f})", f"{f}**4", f"{f}**5")
    for axis in system.axes:
        turn = f"2*pi*{axis.name}/{axis.length!r}"
        yield from (f"sin({turn})", f"cos({turn})")
        yield from (f"{f}*{wave}({turn})" for f in system.fields for wave in ("sin", "cos"))
