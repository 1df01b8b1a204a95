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
from dashred.inference.fit.law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.inference.hypotheses.extended.nonlinear_constants import (
    Tunable,
    moved,
    slopes_of,
    tunable,
    tune,
    within_reach,
)
from dashred.inference.hypotheses.free_forcing import FreeForcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.windows.screening import profile_out
from dashred.inference.hypotheses.windows.windowed_hypothesis import Hypothesis
from dashred.physics.library import build_library
from dashred.physics.system import System, Term

# Terms that are fitted, of those that screen best.
TRIED = 4
STEPS, TOLERANCE = 10, 1e-4


def extended_candidates(
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
    further = []
    for equation in dict.fromkeys(term.equation for term in library):
        for text in _texts(system):
            try:
                [term] = build_library(system, {equation: [text]})
            except InputError:
                continue
            if str(term) not in known:
                further.append(term)
    names = {f"{term.equation}: {term}" for term in further}
    found = build_candidates(system, [*library, *further], nominal, t)
    return [replace(c, is_extended=True) for c in found if str(c) in names]


@dataclass(frozen=True)
class _Form:
    """A law to be asked.

    Attributes:
        members: columns of the linearised problem: a term, a wave's two, or a term and its slope.
        family: of several that differ in a constant alone the best is fitted.
        tuned: a term whose constant is fitted; None for others.
    """

    members: tuple[int, ...]
    family: object
    tuned: Tunable | None = None

    def penalty(self, samples: float, candidates: int) -> float:
        """Return what its freedom costs; a constant, as much as an edge of a window."""
        if self.tuned is None:
            return Hypothesis(self.members).penalty(samples, candidates, 1)
        return Hypothesis(self.members[:1]).penalty(samples, candidates, 1) + math.log(samples)

    def screened(self, problem: ProfiledProblem) -> tuple[float, Tensor]:
        """Return F of the linearised problem, and the coefficients there."""
        if self.tuned is not None:
            return within_reach(problem, self.members, self.tuned.constant)
        [cost] = problem.costs([self.members]).tolist()
        return cost, problem.coefficients(self.members)


def extended_laws(
    everything: LeastSquaresProblem,
    further: Sequence[Candidate],
    forced: FreeForcing,
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
    columns, asked = list(further), [*further, *slopes_of(further)]
    # In reach: what is fitted, and what the forcing's trajectory is run with.
    reach = everything.with_candidates([*asked, *forced.objective.forward_model.law.candidates])
    objective = reach.subset(range(len(columns)))
    problem = profile_out(objective, forced, asked, reach.prior_std[: len(asked)])
    samples, count = objective.noise.effective_count, library + len(columns)
    ranked = []
    for form in _forms(columns):
        cost, coefficients = form.screened(problem)
        penalty = form.penalty(samples, count)
        if cost + penalty < bound:
            ranked.append((cost + penalty, penalty, form, coefficients))
    kept: dict[object, tuple[float, _Form, Tensor]] = {}
    for _, penalty, form, coefficients in sorted(ranked, key=lambda each: each[0]):
        kept.setdefault(form.family, (penalty, form, coefficients))
    return [
        _fit(objective, forced, form, coefficients, penalty)
        for penalty, form, coefficients in list(kept.values())[:TRIED]
    ]


def _forms(columns: Sequence[Candidate]) -> list[_Form]:
    """Return the laws of one column, of a wave's two, and of a term and its slope."""
    inner = [tunable(candidate) for candidate in columns]
    family = [found.family if found else j for j, found in enumerate(inner)]
    place = {candidate.key: j for j, candidate in enumerate([*columns, *slopes_of(columns)])}
    curved = [
        _Form((j, place[found.slope.key]), family[j], found)
        for j, found in enumerate(inner)
        if found
    ]
    waves = [_Form(pair, pair) for pair in _waves(columns)]
    return [*(_Form((j,), family[j]) for j in range(len(columns))), *waves, *curved]


def _fit(
    objective: LeastSquaresProblem,
    forced: FreeForcing,
    form: _Form,
    coefficients: Tensor,
    penalty: float,
) -> HypothesisFit:
    start = forced.phi[: objective.modes]
    if form.tuned is not None:
        xi, by_constant = coefficients.tolist()
        begin = form.tuned.at(moved(form.tuned, xi, by_constant))
        _, mine, fitted = tune(objective, begin, torch.cat([start, coefficients[:1]]))
    else:
        mine = objective.with_candidates(
            [objective.forward_model.law.candidates[j] for j in form.members]
        )
        fitted = minimise(mine, torch.cat([start, coefficients]), STEPS, TOLERANCE)
    return HypothesisFit(build_law(mine, fitted, fitted.cost + penalty), mine, fitted.phi)


def _waves(candidates: Sequence[Candidate]) -> list[tuple[int, int]]:
    """Return the pairs of a sine and the same cosine: their sum is a wave of any phase."""
    place = {candidate.key: j for j, candidate in enumerate(candidates)}
    swapped = {j: key.replace("sin(", "cos(") for key, j in place.items() if "sin(" in key}
    return [(j, place[key]) for j, key in swapped.items() if key in place]


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
