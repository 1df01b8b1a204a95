"""Which part of a port-Hamiltonian system a law changes, and whether it stays one."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.discovery.candidates import Candidate
from dashred.discovery.law import Law
from dashred.physics.algebra import Call, Derivative, Expr, Flux, Number, children, names
from dashred.physics.linear import is_linear, symbol
from dashred.physics.port_hamiltonian import Part, PortHamiltonian, alike, evaluated
from dashred.physics.spectral import Spectral


@dataclass(frozen=True)
class StructureChange:
    """What one candidate of a law changes.

    Attributes:
        candidate: which.
        part: H, the energy; J, how it moves about; R, what takes it away; G, what lets it in; None
            where it fits into none, so that the corrected system is no port-Hamiltonian one.
        passive: whether a changed R still takes energy away; None for other parts.
    """

    candidate: str
    part: Part | None
    passive: bool | None = None


def structure_changes(form: PortHamiltonian, law: Law, states: Tensor) -> list[StructureChange]:
    """Return what each candidate of a law changes.

    Args:
        form: the simulator's structure.
        law: what it leaves out.
        states: any that the fields visit, ``(state, field, *grid)``.
    """
    values = law.coefficients.tolist()
    found = []
    for candidate, value in zip(law.candidates, values, strict=True):
        if candidate.equation is None:
            found.append(_of_parameter(form, candidate, value, states))
        else:
            found.append(_of_term(form, law, candidate, value, states))
    return found


def _of_parameter(
    form: PortHamiltonian, candidate: Candidate, value: float, states: Tensor
) -> StructureChange:
    [part, *_] = [*form.parts_that_read(candidate.name), None]
    if part != "R":
        return StructureChange(candidate.key, part)
    changed = form.with_parameter(candidate.name, value)
    return StructureChange(candidate.key, "R", changed.dissipates(states))


def _of_term(
    form: PortHamiltonian, law: Law, candidate: Candidate, value: float, states: Tensor
) -> StructureChange:
    [term] = candidate.terms
    added = value * evaluated(form.system, term.expression, states)
    effort = evaluated(form.system, form.effort[term.equation], states)
    power = added * effort
    if bool((power <= 0).all()) or bool((power >= 0).all()):
        # (J − R) δH/δx with a further R(x) = -added/effort of one sign.
        return StructureChange(candidate.key, "R", bool((power <= 0).all()))
    if _has_counterpart(form, law, candidate, value, states):
        return StructureChange(candidate.key, "J")
    if _is_of_an_energy(form, term.equation, term.expression):
        return StructureChange(candidate.key, "H")
    if names(term.expression) & set(form.system.config.inputs):
        return StructureChange(candidate.key, "G")
    return StructureChange(candidate.key, None)


def _has_counterpart(
    form: PortHamiltonian, law: Law, candidate: Candidate, value: float, states: Tensor
) -> bool:
    """Tell whether another term of the law takes from its field what this one gives: J stays skew.

    Their powers, added times effort, cancel at every state to within two standard deviations.
    """
    powers = []
    for other, xi, std in zip(law.candidates, law.coefficients, law.std, strict=True):
        if other.equation in (None, candidate.equation):
            continue
        [term] = other.terms
        effort = evaluated(form.system, form.effort[term.equation], states)
        powers.append((evaluated(form.system, term.expression, states) * effort, xi, std))
    [term] = candidate.terms
    own = evaluated(form.system, term.expression, states)
    given = own * evaluated(form.system, form.effort[term.equation], states)
    for taken, xi, std in powers:
        ratio = float((given * taken).sum() / taken.square().sum())
        if alike(given, ratio * taken) and abs(value * ratio + float(xi)) < 2 * float(std):
            return True
    return False


def _is_of_an_energy(form: PortHamiltonian, equation: str, expression: Expr) -> bool:
    """Tell whether a term is what a further energy of one field drives an equation with."""
    row = form.interconnection.get(equation, {})
    sources = [field for field, entry in row.items() if isinstance(entry, Number) and entry.value]
    if len(sources) != 1:
        return False
    [source] = sources
    operators = form.system.operators
    if isinstance(operators, Spectral) and is_linear(expression, source):
        # A self-adjoint operator A is the variation of ½∫ f A f.
        known = symbol(expression, operators, torch.device("cpu"))
        turned = torch.as_tensor(known, dtype=torch.complex128)
        return alike(turned, turned.conj())
    # A pointwise function is that of its integral.
    return names(expression) <= {source} and not _has_operators(expression)


def _has_operators(expression: Expr) -> bool:
    spatial = isinstance(expression, Derivative | Flux) or (
        isinstance(expression, Call) and expression.function in ("lap", "inv_lap", "grad2")
    )
    return spatial or any(_has_operators(child) for child in children(expression))
