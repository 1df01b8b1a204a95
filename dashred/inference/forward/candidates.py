"""Candidates for the model error: missing library terms and changed parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.inference.forward.candidate_columns import (
    Columns,
    in_units,
    program_effects,
    term_column,
    term_rates,
)
from dashred.inference.forward.stable_limit import stable_limit
from dashred.physics.parameter_sensitivity import parameter_tendency
from dashred.physics.program_parameters import parameter_term
from dashred.physics.runs.tendency_size import program_slopes, tendency_size
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import System, Term
from dashred.physics.terms.collinear_terms import (
    COLLINEARITY_TOLERANCE,
    constant_fields,
    may_differ,
)
from dashred.physics.terms.let_terms import resolved_let_term
from dashred.physics.terms.library import resolve
from dashred.physics.window import Window

# Number of states at which a program is asked for the effects of its parameters.
PROBED = 64
# If a program takes longer for a state, in s, its parameters are candidates only with a spread.
EXPENSIVE = 0.02


class ChangePrior(NamedTuple):
    """Normal prior on the change of an uncertain parameter, in the user's unit.

    Attributes:
        mean: the stated value less the value in the system.
        std: the spread.
    """

    mean: float
    std: float


@dataclass(frozen=True)
class Candidate:
    """One unknown coefficient ξ of the model error ``Σ ξ θ(u)``.

    Attributes:
        name: the term that ξ multiplies, as the user writes it, ``u**3``; or the parameter to which
            ξ is added.
        equation: equation of the term, or the let to which ``ξ θ`` is added; None for a parameter.
        terms: tendency per unit of ξ, resolved: the term, ``∂N/∂p`` of each equation for a
            parameter p, or ``∂N/∂m θ`` for a let m.
        scale: ξ at which its tendency has the same rms as the tendency of the equation.
        limit: largest |ξ| for which the time step is stable; inf for most candidates.
        aliases: parameters whose change has the same effect to first order.
        replaces: library terms, ``equation: term``, that a parameter replaces.
        window: window in which it acts; None everywhere.
        is_extended: whether it is not a term of the library.
        prior: of the change of an uncertain parameter; None for a candidate for what is missing.
        in_program: whether it is a parameter that the program of the system reads.
    """

    name: str
    equation: str | None
    terms: tuple[Term, ...]
    scale: float
    limit: float = math.inf
    aliases: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    window: Window | None = None
    is_extended: bool = False
    prior: ChangePrior | None = None
    in_program: bool = False

    @property
    def effects(self) -> tuple[Term, ...]:
        """The terms, and the change of the program's parameter (:mod:`.program_parameters`)."""
        return (*self.terms, parameter_term(self.name)) if self.in_program else self.terms

    @property
    def key(self) -> str:
        """``u: u**3`` or ``parameter nu``, without the window."""
        return f"{self.equation}: {self.name}" if self.equation else f"parameter {self.name}"

    def __str__(self) -> str:
        """``u: u**3`` or ``parameter nu``, with the window if there is one."""
        return f"{self.key} {self.window}" if self.window else self.key


def build_candidates(
    system: System,
    library: Sequence[Term],
    nominal: Tensor,
    t: float | Tensor,
    extensions: Sequence[Term] = (),
    priors: Mapping[str, ChangePrior] | None = None,
    let_terms: Sequence[Term] = (),
    moved: Tensor | None = None,
) -> list[Candidate]:
    """Return parameters, library terms and terms of lets as candidates, without collinear ones.

    Two candidates are collinear if their tendencies are proportional over the nominal simulation.
    Of collinear parameters the first remains, with the others as aliases. A parameter replaces a
    collinear term. Every uncertain parameter remains, because its prior makes it distinct. Terms
    of fields that are equal in the simulation alone remain, too.

    Args:
        system: the simulator.
        library: the candidate terms.
        nominal: states of the simulator, ``(time, field, *grid)``.
        t: time of all states, or of each, ``(time,)``.
        extensions: terms of ``library`` that were added to it.
        priors: of the uncertain parameters, by name.
        let_terms: candidate terms of lets.
        moved: other states, each field moved by itself, as ``nominal``; None without any.
    """
    known = priors or {}
    ordered = sorted(system.config.parameters, key=lambda name: name not in known)
    parameters = [_parameter(system, name, known.get(name)) for name in ordered]
    every = -(-len(nominal) // PROBED)
    few = nominal[::every], t[::every] if isinstance(t, Tensor) else t
    effects = program_effects(system, _unknown_in_program(system, parameters), *few)
    parameters = [replace(c, in_program=c.name in effects) for c in parameters]
    resolved = resolve(system, library)
    terms = [
        Candidate(str(term), term.equation, (ready,), 1.0, is_extended=term in extensions)
        for term, ready in zip(library, resolved, strict=True)
    ]
    shared = [
        Candidate(str(term), term.equation, resolved_let_term(system, term), 1.0)
        for term in let_terms
    ]
    found = [c for c in parameters if c.effects or c.prior] + terms + shared
    if not found:
        return []
    rms = tendency_size(system, nominal, t)
    columns = Columns.of(
        [term_column(system, c.terms, nominal, t, rms) for c in found],
        {j: in_units(effects[c.name], rms) for j, c in enumerate(found) if c.in_program},
        every,
    )
    constant = frozenset[str]() if moved is None else constant_fields(system, nominal)
    independent: list[int] = []
    aliases: dict[int, list[str]] = {}
    replaced: dict[int, list[str]] = {}
    for j, candidate in enumerate(found):
        if candidate.prior is not None:
            independent.append(j)
            continue
        if not 0 < columns.sizes[j] < math.inf:
            continue
        cosines = columns.cosines(j, independent)
        alike = torch.nonzero(cosines > 1 - COLLINEARITY_TOLERANCE).flatten().tolist()
        collinear = [
            i
            for i in (independent[each] for each in alike)
            if moved is None or not _differ_on(system, candidate, found[i], constant, moved, t, rms)
        ]
        if not collinear:
            independent.append(j)
            continue
        first = collinear[0]
        if candidate.equation is None:
            aliases.setdefault(first, []).append(candidate.name)
        else:
            replaced.setdefault(first, []).append(str(candidate))
    return [
        replace(
            found[j],
            scale=columns.scale(j),
            limit=stable_limit(system, found[j].terms),
            aliases=tuple(aliases.get(j, ())),
            replaces=tuple(replaced.get(j, ())),
        )
        for j in independent
    ]


def _differ_on(
    system: System,
    one: Candidate,
    other: Candidate,
    constant: frozenset[str],
    states: Tensor,
    t: float | Tensor,
    rms: Tensor,
) -> bool:
    """Return whether candidates of several or of constant fields are not proportional on states."""
    if not any(
        may_differ(system, mine.expression, theirs.expression, constant)
        for mine in one.terms
        for theirs in other.terms
        if mine.equation == theirs.equation
    ):
        return False
    columns = [term_column(system, each.terms, states, t, rms) for each in (one, other)]
    pair = Columns.of(columns, {}, 1)
    return bool(pair.cosines(0, [1]) < 1 - COLLINEARITY_TOLERANCE)


def replaced_terms(
    system: System,
    library: Sequence[Term],
    candidates: Sequence[Candidate],
    nominal: Tensor,
    t: float | Tensor,
) -> list[Candidate]:
    """Return the library terms that parameters replace: in a window they are distinct from these.

    Args:
        system: the simulator.
        library: the candidate terms.
        candidates: the result of :func:`build_candidates`.
        nominal: states of the simulator, ``(time, field, *grid)``.
        t: time of all states, or of each, ``(time,)``.
    """
    replaced = {name for candidate in candidates for name in candidate.replaces}
    rms, found = tendency_size(system, nominal, t), []
    for term, ready in zip(library, resolve(system, library), strict=True):
        candidate = Candidate(str(term), term.equation, (ready,), 1.0)
        if candidate.key in replaced:
            size = float(term_column(system, candidate.terms, nominal, t, rms).norm())
            scale = math.sqrt(nominal[:, 0].numel()) / size
            found.append(
                replace(candidate, scale=scale, limit=stable_limit(system, candidate.terms))
            )
    return found


def indices_by_name(candidates: Sequence[Candidate]) -> dict[str, int]:
    """Return the index of the candidate for each library term, ``equation: term``."""
    return {name: j for j, found in enumerate(candidates) for name in (str(found), *found.replaces)}


def build_forcing(candidates: Sequence[Candidate], coefficients: Tensor) -> Forcing:
    """Return the model error with coefficients ``(batch, candidate)``, in the user's units."""
    terms = tuple(term for candidate in candidates for term in candidate.effects)
    owner = [j for j, candidate in enumerate(candidates) for _ in candidate.effects]
    return Forcing(terms, coefficients[:, owner])


def _parameter(system: System, name: str, prior: ChangePrior | None) -> Candidate:
    tendencies = parameter_tendency(system, name)
    terms = tuple(Term(equation, expr) for equation, expr in tendencies.items())
    return Candidate(name, None, terms, 1.0, prior=prior)


def candidate_rates(
    system: System, candidate: Candidate, states: Tensor, t: float | Tensor
) -> Tensor:
    """Return the tendency per unit of ξ, ``(batch, field, *grid)``.

    Args:
        system: the simulator.
        candidate: the term or parameter.
        states: ``(batch, field, *grid)``.
        t: time of all states, or of each, ``(batch,)``.
    """
    rates = term_rates(system, candidate.terms, states, t)
    if candidate.in_program:
        # The program may fail at some states.
        [effect] = program_slopes(system, states, t, [candidate.name])
        rates += effect.nan_to_num(nan=0.0)
    return rates


def _unknown_in_program(system: System, parameters: Sequence[Candidate]) -> list[str]:
    """Return the parameters whose changes may be unknowns if a program reads them.

    For an expensive program they need a spread: each parameter takes one more call in a step.
    """
    if system.program is None:
        return []
    is_cheap = system.program.seconds <= EXPENSIVE
    return [each.name for each in parameters if is_cheap or each.prior is not None]
