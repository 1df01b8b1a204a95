"""Laws one step beyond the library, for recordings that no law of it explains (design §4.3.8)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from dashred.discovery.candidates import Candidate, build_candidates
from dashred.discovery.free_forcing import FreeForcing
from dashred.discovery.gauss_newton import minimise
from dashred.discovery.hypothesis import Hypothesis
from dashred.discovery.law import law_of
from dashred.discovery.local_laws import Cause
from dashred.discovery.objective import Objective
from dashred.discovery.screening import eliminated
from dashred.errors import InputError
from dashred.physics.library import build_library
from dashred.physics.system import System, Term

# Terms that are fitted, of those that screen best.
TRIED = 4
STEPS, TOLERANCE = 10, 1e-4


def candidates_beyond(
    system: System, library: list[Term], nominal: Tensor, t: float
) -> list[Candidate]:
    """Return terms that are like none of the library's: functions, higher powers, waves.

    Args:
        system: the simulator.
        library: the candidate terms of the analysis.
        nominal: states of the simulator, ``(time, field, *grid)``.
        t: time at which terms that read it are compared.
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
    return [replace(c, beyond=True) for c in found if str(c) in names]


def laws_beyond(objective: Objective, forced: FreeForcing, library: int) -> list[Cause]:
    """Return laws of one term from beyond the library, or of a wave whose phase is free.

    Args:
        objective: F of these terms, over the whole record.
        forced: a free forcing that explains the recording without a law.
        library: how many candidates the library has: each more that is asked makes chance likelier.
    """
    modes, columns = objective.modes, list(objective.shooting.candidates)
    fields = len(objective.shooting.simulator.system.fields)
    problem = eliminated(objective, forced, columns, objective.prior_std)
    singles = [(j,) for j in range(len(columns))]
    samples, count = objective.noise.effective_count, library + len(columns)
    ranked = []
    for laws in (singles, _waves(columns)):
        penalties = [Hypothesis(law).penalty(samples, count, fields) for law in laws]
        costs = problem.costs(laws).tolist() if laws else []
        ranked += [(c + p, p, law) for c, p, law in zip(costs, penalties, laws, strict=True)]
    found = []
    for _, penalty, law in sorted(ranked)[:TRIED]:
        mine = objective.only(law)
        begin = torch.cat([forced.phi[:modes], problem.coefficients(law)])
        fitted = minimise(mine, begin, STEPS, TOLERANCE)
        terms = tuple(columns[j] for j in law)
        told = law_of(mine, fitted, terms, fitted.cost + penalty)
        found.append(Cause(told, mine, fitted.phi))
    return found


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
