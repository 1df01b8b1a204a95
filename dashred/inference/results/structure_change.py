"""The part of a port-Hamiltonian system that a law changes, and whether the structure remains.

The simulator is ``∂x/∂t = (J − R) e + G u`` with ``e = δH/δx``. The power ``∫ e θ`` of a term shows
its part: a change of R dissipates energy and a change of J conserves it, at any state. The
corrected system is port-Hamiltonian if only its ports add energy to its H, which the law may
change, too: any tendency a with ``∫ e a ≤ 0`` is ``(J − R) e`` with a skew J and an R ⪰ 0.
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

# Smallest relevant power, as a share of the gross power: less is the error of the grid.
TOLERANCE = 1e-4
# Number of standard deviations within which coefficients may belong to a passive system.
CONFIDENCE = 2.0


@dataclass(frozen=True)
class StructureChange:
    """The change of the structure by one candidate of a law.

    Attributes:
        candidate: key of the candidate.
        part: H, the energy; J, its exchange; R, its dissipation; G, the input; None for no single
            part.
        passive: whether a change of R alone removes energy; None for other parts.
    """

    candidate: str
    part: Part | None
    passive: bool | None = None


def structure_changes(
    form: PortHamiltonian, law: Law, states: SampledStates
) -> list[StructureChange]:
    """Return the change of the structure by each candidate of a law.

    Args:
        form: structure of the simulator.
        law: the law.
        states: sampled states of the fields, each with its time.
    """
    at = form.defined(states.with_waves(form.system))
    found = []
    for index, candidate in enumerate(law.candidates):
        if candidate.equation is None:
            found.append(_classify_parameter(form, candidate, float(law.coefficients[index]), at))
        else:
            found.append(_classify_term(form, law, index, at))
    return found


def stays_port_hamiltonian(
    form: PortHamiltonian, law: Law, changes: Sequence[StructureChange], states: SampledStates
) -> bool:
    """Return whether the corrected system is port-Hamiltonian: J skew, and R ⪰ 0 in total.

    Args:
        form: structure of the simulator.
        law: the law.
        changes: the change by each candidate of the law.
        states: sampled states of the fields, each with its time.
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
                given, gross_power = _power(form, term, efforts, at)
                slope, size = slope + given, size + gross_power
        slopes.append(slope)
        if candidate.equation is not None:
            power, gross = power + xi * slope, gross + abs(xi) * size
    std = torch.einsum("is,ij,js->s", torch.stack(slopes), law.covariance, torch.stack(slopes))
    return bool((power <= CONFIDENCE * std.clamp(min=0).sqrt() + TOLERANCE * gross).all())


def _classify_parameter(
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


def _classify_term(
    form: PortHamiltonian, law: Law, index: int, at: SampledStates
) -> StructureChange:
    candidate = law.candidates[index]
    [term] = candidate.terms
    if _is_input_term(form, term):
        return StructureChange(candidate.key, "G")
    power, size = _power(form, term, _efforts(form, at), at)
    gained = float(law.coefficients[index]) * power
    threshold = abs(float(law.coefficients[index])) * TOLERANCE * size
    removes, adds = bool((gained < -threshold).any()), bool((gained > threshold).any())
    if removes != adds:
        # (J − R) δH/δx with a further R of one sign.
        return StructureChange(candidate.key, "R", removes)
    if (not removes and bool(size.any())) or _has_counterpart(form, law, index, at):
        return StructureChange(candidate.key, "J")
    if _is_energy_term(form, term, at):
        return StructureChange(candidate.key, "H")
    return StructureChange(candidate.key, None)


def _efforts(form: PortHamiltonian, at: SampledStates) -> dict[str, Tensor]:
    """Return ``δH/δx`` of every field, ``(state, *grid)``."""
    return {field: evaluate(form.system, effort, at) for field, effort in form.effort.items()}


def _changed_efforts(
    changed: PortHamiltonian, law: Law, changes: Sequence[StructureChange], at: SampledStates
) -> dict[str, Tensor]:
    """Return ``δH/δx`` for H of the corrected system, with its parameters and further terms."""
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
    """Return ``∫ e θ`` and ``∫ |e θ|``, ``(state,)``; a value that is not finite counts as 0."""
    given = efforts[term.equation] * evaluate(form.system, term.expression, at)
    given = torch.nan_to_num(given, nan=0.0, posinf=0.0, neginf=0.0)
    grid = form.system.product_grid
    own = grid.own(given).abs().reshape(len(given), -1).sum(dim=1)
    return integral(grid, given), own * math.prod(axis.spacing for axis in grid.axes)


def _is_input_term(form: PortHamiltonian, term: Term) -> bool:
    """Return whether a term is an input times a factor without inputs."""
    expr = term.expression
    factors = expr.factors if isinstance(expr, Product) else (expr,)
    inputs = frozenset(form.system.config.inputs)
    reading = [factor for factor in factors if names(factor) & inputs]
    return len(reading) == 1 and isinstance(reading[0], Name)


def _has_counterpart(form: PortHamiltonian, law: Law, index: int, at: SampledStates) -> bool:
    """Return whether another term of the law removes the power that this one adds: J stays skew.

    Their powers, including the coefficients, cancel at every state within their error.
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
        if close_fields(given, ratio * taken) and abs(left) < CONFIDENCE * variance**0.5:
            return True
    return False


def _driven_by(form: PortHamiltonian, equation: str) -> tuple[str, float]:
    """Return the field whose effort alone drives an equation, and drives no other, and J's entry.

    The result is ``("", 0)`` if there is none.
    """
    row = form.interconnection.get(equation, {})
    entries = [*form.interconnection.values(), *form.dissipation.values()]
    for field, entry in row.items():
        alone = len(row) == 1 and sum(field in other for other in entries) == 1
        if alone and isinstance(entry, Number) and entry.value:
            return field, entry.value
    return "", 0.0


def _is_energy_term(form: PortHamiltonian, term: Term, at: SampledStates) -> bool:
    """Return whether a term comes from a further energy of the field that drives its equation.

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
    a, b = random_waves(system.product_grid, 1).sum(dim=0)[:2, 0]
    with torch.enable_grad():
        states = at.states.clone().requires_grad_()
        theta = evaluate(system, term.expression, SampledStates(states, at.times))
        if not theta.requires_grad:
            return True
        along_b, along_a = (
            torch.autograd.grad(
                integral(system.product_grid, theta * c).sum(), states, retain_graph=True
            )
            for c in (b, a)
        )
    left, right = (
        torch.nan_to_num(slope[:, index] * along, nan=0.0, posinf=0.0, neginf=0.0)
        for [slope], along in ((along_b, a), (along_a, b))
    )
    size = float(left.abs().sum())
    return abs(float(left.sum() - right.sum())) <= TOLERANCE * size
