"""Which part of a port-Hamiltonian system a law changes, and whether it remains one.

What a law adds to ``∂x/∂t = (J − R) e + G u``, ``e = δH/δx``, follows from its power ``∫ e θ``:
a further R dissipates energy, a further J conserves it, at any state. The corrected system as a
whole is port-Hamiltonian if only its ports add energy to its H, which may be changed, too: any
tendency a with ``∫ e a ≤ 0`` is ``(J − R) e`` of a skew J and an R ⪰ 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import Candidate
from dashred.inference.results.parameter_change import parameter_change
from dashred.physics.expressions.algebra import Name, Number, Product, names
from dashred.physics.grids.quadrature import integral
from dashred.physics.port_hamiltonian import Part, PortHamiltonian, close_fields
from dashred.physics.sampled_states import SampledStates, evaluate, random_waves, without_sides
from dashred.physics.system import Term

# Of the energy that is moved: less is the grid's own error.
CONSERVED = 1e-4
# Standard deviations up to which coefficients may be those of a system that gives no energy.
SURE = 2.0


@dataclass(frozen=True)
class StructureChange:
    """What one candidate of a law changes.

    Attributes:
        candidate: which.
        part: H, the energy; J, its exchange; R, its dissipation; G, the input; None where it is no
            single part.
        passive: whether a change of R takes energy away, by itself; None for other parts.
    """

    candidate: str
    part: Part | None
    passive: bool | None = None


def structure_changes(
    form: PortHamiltonian, law: Law, states: SampledStates
) -> list[StructureChange]:
    """Return what each candidate of a law changes.

    Args:
        form: the simulator's structure.
        law: what it leaves out.
        states: that the fields visit, each at its own time.
    """
    at = form.defined(states.with_waves(form.system))
    found = []
    for index, candidate in enumerate(law.candidates):
        if candidate.equation is None:
            found.append(_of_parameter(form, candidate, float(law.coefficients[index]), at))
        else:
            found.append(_of_term(form, law, index, at))
    return found


def stays_port_hamiltonian(
    form: PortHamiltonian, law: Law, changes: Sequence[StructureChange], states: SampledStates
) -> bool:
    """Tell whether the corrected system, as a whole, is port-Hamiltonian: J skew, and R ⪰ 0 in sum.

    Args:
        form: the simulator's structure.
        law: what it leaves out.
        changes: of each of its candidates.
        states: that the fields visit, each at its own time.
    """
    values = law.coefficients.tolist()
    moved = {
        candidate.name: parameter_change(form.system, candidate.name, xi)
        for candidate, xi in zip(law.candidates, values, strict=True)
        if candidate.equation is None
    }
    changed = form.with_parameters(moved)
    at = changed.defined(states.with_waves(form.system))
    if not changed.is_skew(at):
        return False
    efforts = _changed_efforts(changed, law, changes, at)
    power = -changed.dissipated_power(at, efforts)
    gross, slopes = power.abs(), []
    for candidate, xi, change in zip(law.candidates, values, changes, strict=True):
        slope, size = torch.zeros_like(power), torch.zeros_like(power)
        if change.part not in ("H", "G"):
            for term in candidate.terms:
                given, turned_over = _power(form, term, efforts, at)
                slope, size = slope + given, size + turned_over
        slopes.append(slope)
        if candidate.equation is not None:
            power, gross = power + xi * slope, gross + abs(xi) * size
    std = torch.einsum("is,ij,js->s", torch.stack(slopes), law.covariance, torch.stack(slopes))
    return bool((power <= SURE * std.clamp(min=0).sqrt() + CONSERVED * gross).all())


def _of_parameter(
    form: PortHamiltonian, candidate: Candidate, xi: float, at: SampledStates
) -> StructureChange:
    [part, *_] = [*form.parts_with_parameter(candidate.name), None]
    if part != "R":
        return StructureChange(candidate.key, part)
    efforts = _efforts(form, at)
    change = parameter_change(form.system, candidate.name, xi)
    changed = form.with_parameters({candidate.name: change})
    before, after = (each.dissipated_power(at, efforts) for each in (form, changed))
    return StructureChange(candidate.key, "R", bool((after >= before).all()))


def _of_term(form: PortHamiltonian, law: Law, index: int, at: SampledStates) -> StructureChange:
    candidate = law.candidates[index]
    [term] = candidate.terms
    if _is_let_in(form, term):
        return StructureChange(candidate.key, "G")
    power, size = _power(form, term, _efforts(form, at), at)
    gained = float(law.coefficients[index]) * power
    slight = abs(float(law.coefficients[index])) * CONSERVED * size
    takes, gives = bool((gained < -slight).any()), bool((gained > slight).any())
    if takes != gives:
        # (J − R) δH/δx with a further R of one sign.
        return StructureChange(candidate.key, "R", takes)
    if (not takes and bool(size.any())) or _has_counterpart(form, law, index, at):
        return StructureChange(candidate.key, "J")
    if _is_of_an_energy(form, term, at):
        return StructureChange(candidate.key, "H")
    return StructureChange(candidate.key, None)


def _efforts(form: PortHamiltonian, at: SampledStates) -> dict[str, Tensor]:
    """Return ``δH/δx`` of every field, ``(state, *grid)``."""
    return {field: evaluate(form.system, effort, at) for field, effort in form.effort.items()}


def _changed_efforts(
    changed: PortHamiltonian, law: Law, changes: Sequence[StructureChange], at: SampledStates
) -> dict[str, Tensor]:
    """Return ``δH/δx`` of the corrected system's H: parameters changed, and terms of a new one."""
    efforts = _efforts(changed, at)
    values = law.coefficients.tolist()
    for candidate, xi, change in zip(law.candidates, values, changes, strict=True):
        if candidate.equation is not None and change.part == "H":
            [term] = candidate.terms
            source, entry = _driven_by(changed, term.equation)
            added = evaluate(changed.system, term.expression, at)
            efforts[source] = efforts[source] + xi / entry * added
    return efforts


def _power(
    form: PortHamiltonian, term: Term, efforts: dict[str, Tensor], at: SampledStates
) -> tuple[Tensor, Tensor]:
    """Return ``∫ e θ`` and ``∫ |e θ|``, ``(state,)``; 0 where a term is not finite."""
    given = efforts[term.equation] * evaluate(form.system, term.expression, at)
    given = torch.nan_to_num(given, nan=0.0, posinf=0.0, neginf=0.0)
    grid = form.system.grid
    own = grid.own(given).abs().reshape(len(given), -1).sum(dim=1)
    return integral(grid, given), own * math.prod(axis.spacing for axis in grid.axes)


def _is_let_in(form: PortHamiltonian, term: Term) -> bool:
    """Tell whether a term is an input times what reads none."""
    expr = term.expression
    factors = expr.factors if isinstance(expr, Product) else (expr,)
    inputs = frozenset(form.system.config.inputs)
    reading = [factor for factor in factors if names(factor) & inputs]
    return len(reading) == 1 and isinstance(reading[0], Name)


def _has_counterpart(form: PortHamiltonian, law: Law, index: int, at: SampledStates) -> bool:
    """Tell whether another term of the law takes from its field what this one gives: J stays skew.

    Their powers, coefficients included, cancel at every state to within their error.
    """
    efforts, xi, covariance = _efforts(form, at), law.coefficients, law.covariance
    [term] = law.candidates[index].terms
    given, _ = _power(form, term, efforts, at)
    for other, candidate in enumerate(law.candidates):
        if candidate.equation in (None, term.equation):
            continue
        taken, _ = _power(form, candidate.terms[0], efforts, at)
        ratio = float((given * taken).sum() / taken.square().sum())
        pair = torch.zeros_like(xi)
        pair[index], pair[other] = ratio, 1.0
        left, variance = float(pair @ xi), float(pair @ covariance @ pair)
        if close_fields(given, ratio * taken) and abs(left) < SURE * variance**0.5:
            return True
    return False


def _driven_by(form: PortHamiltonian, equation: str) -> tuple[str, float]:
    """Return the field whose effort alone drives an equation and nothing else, and J's entry.

    ``("", 0)`` where there is none.
    """
    row = form.interconnection.get(equation, {})
    entries = [*form.interconnection.values(), *form.dissipation.values()]
    for field, entry in row.items():
        alone = len(row) == 1 and sum(field in other for other in entries) == 1
        if alone and isinstance(entry, Number) and entry.value:
            return field, entry.value
    return "", 0.0


def _is_of_an_energy(form: PortHamiltonian, term: Term, at: SampledStates) -> bool:
    """Tell whether a term is what a further energy of one field drives an equation with.

    ``θ(f)`` is the variation of an energy of f if its derivative is self-adjoint:
    ``∫ b θ'a = ∫ a θ'b`` for any a and b.
    """
    system = form.system
    source, _ = _driven_by(form, term.equation)
    if not source or not names(without_sides(term.expression, system)) <= {
        source,
        *system.config.axes,
    }:
        return False
    index = system.fields.index(source)
    a, b = random_waves(system.grid, 1).sum(dim=0)[:2, 0]
    with torch.enable_grad():
        states = at.states.clone().requires_grad_()
        theta = evaluate(system, term.expression, SampledStates(states, at.times))
        if not theta.requires_grad:
            return True
        along_b, along_a = (
            torch.autograd.grad(integral(system.grid, theta * c).sum(), states, retain_graph=True)
            for c in (b, a)
        )
    left, right = (
        torch.nan_to_num(slope[:, index] * along, nan=0.0, posinf=0.0, neginf=0.0)
        for [slope], along in ((along_b, a), (along_a, b))
    )
    size = float(left.abs().sum())
    return abs(float(left.sum() - right.sum())) <= CONSERVED * size
